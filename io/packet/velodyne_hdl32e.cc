// HDL-32E: user manual 63-9113.
#include <iterator>

#include "io/packet/velodyne_packet.h"

namespace lamina {
namespace {

constexpr VelodyneBeam kHdl32eBeams[] = {
    {-30.67}, {-9.33}, {-29.33}, {-8.0},  {-28.0},  {-6.67}, {-26.67}, {-5.33},
    {-25.33}, {-4.0},  {-24.0},  {-2.67}, {-22.67}, {-1.33}, {-21.33}, {0.0},
    {-20.0},  {1.33},  {-18.67}, {2.67},  {-17.33}, {4.0},   {-16.0},  {5.33},
    {-14.67}, {6.67},  {-13.33}, {8.0},   {-12.0},  {9.33},  {-10.67}, {10.67}};

}  // namespace

const VelodyneModel kHdl32e = {"HDL-32E", 0x21,  0.002, kHdl32eBeams, std::size(kHdl32eBeams),
                               1,         1.152, 46.08};

}  // namespace lamina
