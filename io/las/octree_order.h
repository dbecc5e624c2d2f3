// Points in the order of an octree (that of Morton codes), sorted outside of memory.
//
// The octree's cube has an edge of 2^levels units from the least coordinates on, so that each cell
// of a level is a range of the points in this order.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string_view>

#include "io/file/spool_file.h"

namespace lamina {

// From the least coordinates on, in units.
using OctreePlace = std::array<std::uint32_t, 3>;

// Of a record that begins with three coordinates (int32).
OctreePlace OctreePlaceOf(const char* record, const std::array<std::int32_t, 3>& least);

// Bits up to the highest in which a coordinate of the two differs; 0 if they are the same. Both are
// in one cell of the level at which cells have an edge of 2^k units if it is at most k.
int DifferingBits(const OctreePlace& a, const OctreePlace& b);

// Visits all records of the spool, which changes their order in it, in the order of the octree;
// those of one place in that of their bytes. Takes some 64 MB. Throws OutputError.
void VisitInOctreeOrder(SpoolFile* spool, std::size_t record_bytes,
                        const std::array<std::int32_t, 3>& least,
                        const std::function<void(std::string_view record)>& visit);

}  // namespace lamina
