// Sequences for a comparison: one recording, the eight synthetic ones, or the ETHZ data set.
#pragma once

#include <string>
#include <vector>

#include "tools/compare/sequence.h"

namespace lamina {

// A recording and its truth, a pose for each scan. Throws InputError.
CompareSequence OpenSequence(const std::string& name, const std::string& scans,
                             const std::string& truth, const std::string& reference,
                             const CompareConfig& config);

// The eight scenes of tools/synth/stations.h, written below `folder` while they are needed.
// `quick`: two of them, few and coarse scans.
std::vector<CompareSequence> EthzLikeSequences(const std::string& folder, int seed, bool quick,
                                               bool keep);

// What of the eight sequences is found anywhere below the folder, by the names of the folders that
// hold Hokuyo_*.csv. Throws InputError if there is none.
std::vector<CompareSequence> EthzSequences(const std::string& folder, const CompareConfig& config);

}  // namespace lamina
