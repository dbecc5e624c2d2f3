// graph.g2o: anchors of submaps and the edges between them, as a file that others read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backend/anchors/anchor_graph.h"

namespace lamina {

// graph.g2o, or that of a further frame.
std::string GraphFileName(std::int64_t frame);

// These poses of a graph, numbered anew from 0, with the edges among them.
AnchorGraph PartOfGraph(const AnchorGraph& graph, const std::vector<std::size_t>& poses);

// The first pose is fixed. Throws OutputError.
void WriteAnchorGraph(const std::string& path, const AnchorGraph& graph);

}  // namespace lamina
