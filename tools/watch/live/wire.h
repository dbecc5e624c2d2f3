// What the live page and the report are fed with, byte by byte. tools/web/wire.js reads it.
//
// All numbers little-endian; iN, uN, fN are integers and floats of N bits. `run` is the run_id of
// the program: a reader that finds another one than it knows starts over.
//
// Trajectory      "LTR2", u32 poses, u64 run, i64 version, i64 next_index (-1: no further page);
//                 then for each pose i64 index, i64 stamp_ns, f64 x y z, f32 qx qy qz qw, i64 piece
// Scan            "LSC2", u32 points, u64 run, i64 index (-1: none yet), f64 x y z of the origin,
//                 i64 piece; then for each point f32 x y z from the origin, axes of the world
// Map             "LMP1", u32 cells, u64 run, i64 version, f64 cell_size_m, u32 surfels in all,
//                 u32 next (the page that follows; 0: none); then for each cell i32 ix iy iz,
//                 u32 surfels, and its surfels:
//                   f32 x y z   centre, from the cell's lower corner (ix, iy, iz) * cell_size_m
//                   i8  nx ny nz, 0   unit normal times 127
//                   u16 radius        of the disc, mm
//                   u16 thickness     0.1 mm
//                   i32 last_keyframe
//                 A cell replaces the one that the reader has at its place; one without surfels
//                 removes it.
//
// Coordinates are in the frame of a piece of the map; those of different pieces must not be drawn
// over one another. A map is of the piece that was asked for.
//
// The disc of a surfel has the area-weighted spread of its points: uniform points on a disc of
// radius r have variance r^2/4 along each axis, so r = 2 (l1 l2)^(1/4).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/map/surfel.h"
#include "tools/watch/live/view.h"

namespace lamina {

// Surfels near a place.
struct MapQuery {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double radius_m = 0.0;
  // 0, or MapPage::next of the page before, for the same centre and radius.
  std::uint32_t page = 0;
  // Cells that have been touched since this version of the map; -1: all.
  std::int64_t newer_than = -1;
  std::int64_t piece = 0;  // of the map, in whose frame the place is
};

struct MapCell {
  std::int32_t ix = 0, iy = 0, iz = 0;
  std::vector<Surfel> surfels;
};

struct MapPage {
  double cell_size_m = 1.0;
  std::vector<MapCell> cells;  // nearest first
  std::uint32_t next = 0;      // number of the page that follows; 0: there is none
  std::int64_t version = 0;
};

std::string EncodeTrajectory(const TrajectoryPage& page, const std::string& run_id);
// `scan` may be null.
std::string EncodeScan(const LiveScan* scan, const std::string& run_id);
std::string EncodeMap(const MapPage& page, const std::string& run_id);

}  // namespace lamina
