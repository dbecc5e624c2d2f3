// The registration methods and features of PCL, and the neighbourhoods of points: nothing of PCL is
// seen by others.
//
// Private to frontend/pairwise.
#pragma once

#include <memory>
#include <vector>

#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

// kIcpPoint, kIcpPlane, kGicp or kNdt. Steps, tolerances and distances are those of the options;
// GICP's covariances come with the clouds, so that a map need not compute them again.
std::unique_ptr<PairwiseMethod> MakePclRegistration(PairwiseKind kind,
                                                    const PairwiseOptions& options);

// Fills cloud->normals and cloud->covariances from the nearest `neighbours` points.
void AddNeighbourhoods(int neighbours, PairwiseCloud* cloud);

// Fills feature_points and features: downsampled to feature_voxel_m, normals towards the sensor
// (the origin), FPFH. Points whose neighbourhood is too small to say anything are left out.
// Returns the smallest eigenvalue of the mean of n n' over the normals: near zero where no surface
// faces some direction, so that motion along it cannot be seen.
double AddFeatures(const PairwiseOptions& options, PairwiseCloud* cloud);

}  // namespace lamina
