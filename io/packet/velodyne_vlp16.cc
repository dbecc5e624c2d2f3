// VLP-16 (Puck): user manual 63-9243.
#include <iterator>

#include "io/packet/velodyne_packet.h"

namespace lamina {
namespace {

constexpr VelodyneBeam kVlp16Beams[] = {
    {-15.0, 0.0, 0.0112}, {1.0, 0.0, -0.0007},  {-13.0, 0.0, 0.0097}, {3.0, 0.0, -0.0022},
    {-11.0, 0.0, 0.0081}, {5.0, 0.0, -0.0037},  {-9.0, 0.0, 0.0066},  {7.0, 0.0, -0.0051},
    {-7.0, 0.0, 0.0051},  {9.0, 0.0, -0.0066},  {-5.0, 0.0, 0.0037},  {11.0, 0.0, -0.0081},
    {-3.0, 0.0, 0.0022},  {13.0, 0.0, -0.0097}, {-1.0, 0.0, 0.0007},  {15.0, 0.0, -0.0112}};

}  // namespace

const VelodyneModel kVlp16 = {"VLP-16", 0x22,  0.002, kVlp16Beams, std::size(kVlp16Beams),
                              1,        2.304, 55.296};

}  // namespace lamina
