// Chunks of LASzip in layers, for point formats 6 to 10:
//
//     first record as it is | points (u32) | bytes of each layer (u32) | layers
//
// Layers of a field that is the same in all points are empty. Of an item POINT14 there are nine, of
// colours one, with near infrared two, of waveforms one, of extra bytes one each.
//
// Private to io/las.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "io/las/laz_points.h"

namespace lamina {

// Of whole records of point format 6, one at least.
std::string PackLayeredChunk(std::string_view records);

// Throws InputError, beginning with `name`. `chunk` has the first record.
void UnpackLayeredChunk(const LazLayout& layout, std::string_view chunk, std::uint64_t points,
                        const std::string& name, const LazVisitor& visit);

}  // namespace lamina
