// VLP-32C (Ultra Puck): user manual 63-9325. Two lasers fire at once.
#include <iterator>

#include "io/packet/velodyne_packet.h"

namespace lamina {
namespace {

constexpr VelodyneBeam kVlp32cBeams[] = {
    {-25.0, 1.4},  {-1.0, -4.2},   {-1.667, 1.4}, {-15.639, -1.4}, {-11.31, 1.4}, {0.0, -1.4},
    {-0.667, 4.2}, {-8.843, -1.4}, {-7.254, 1.4}, {0.333, -4.2},   {-0.333, 1.4}, {-6.148, -1.4},
    {-5.333, 4.2}, {1.333, -1.4},  {0.667, 4.2},  {-4.0, -1.4},    {-4.667, 1.4}, {1.667, -4.2},
    {1.0, 1.4},    {-3.667, -4.2}, {-3.333, 4.2}, {3.333, -1.4},   {2.333, 1.4},  {-2.667, -1.4},
    {-3.0, 1.4},   {7.0, -1.4},    {4.667, 1.4},  {-2.333, -4.2},  {-2.0, 4.2},   {15.0, -1.4},
    {10.333, 1.4}, {-1.333, -1.4}};

}  // namespace

const VelodyneModel kVlp32c = {"VLP-32C", 0x28,  0.004, kVlp32cBeams, std::size(kVlp32cBeams),
                               2,         2.304, 55.296};

}  // namespace lamina
