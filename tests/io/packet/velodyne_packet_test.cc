// Packets of Velodyne sensors: where their points are, and when they were measured.
#include "io/packet/velodyne_packet.h"
#include "core/base/angle.h"

#include <cmath>

#include "tests/support/files/container_files.h"
#include "tests/support/files/velodyne_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr StampNs kPacketStamp = 1700000000000000000;
constexpr std::uint8_t kVlp16Id = 0x22, kVlp32cId = 0x28, kHdl32eId = 0x21;

Scan DecodeVelodyne(const std::vector<std::string>& packets, std::vector<StampNs> stamps = {}) {
  VelodyneDecoder decoder;
  Scan scan;
  for (std::size_t i = 0; i < packets.size(); ++i) {
    decoder.Add(packets[i], stamps.empty() ? kPacketStamp : stamps[i], "a.pcap#1", &scan);
  }
  return scan;
}

TEST(VelodynePacket, PointsOfAVlp16) {
  VelodyneBlocks blocks;
  // Laser 1 (1 deg up) ahead, then half a block later laser 0 (15 deg down), at 90 deg.
  blocks[0].azimuth = 0;
  blocks[0].distance[1] = 5000;
  blocks[0].intensity[1] = 77;
  blocks[1].azimuth = 40;
  blocks[3].azimuth = 9000;
  blocks[3].distance[16] = 2000;
  const Scan scan = DecodeVelodyne({VelodynePacket(blocks, kVlp16Id, 0x37, 1000)});
  ASSERT_THAT(scan.points, SizeIs(2));
  const double up = kDegree, turned = Radians(0.4) * 2.304 / 110.592;
  EXPECT_NEAR(scan.points[0].x, 10.0 * std::cos(up) * std::cos(turned), 1e-5);
  EXPECT_NEAR(scan.points[0].y, -10.0 * std::cos(up) * std::sin(turned), 1e-5);
  EXPECT_NEAR(scan.points[0].z, 10.0 * std::sin(up) - 0.0007, 1e-5);
  EXPECT_EQ(scan.points[0].intensity, 77.0F);
  EXPECT_NEAR(scan.points[1].x, 0.0, 0.03);
  EXPECT_NEAR(scan.points[1].y, -4.0 * std::cos(15 * up), 1e-3);
  EXPECT_NEAR(scan.points[1].z, -4.0 * std::sin(15 * up) + 0.0112, 1e-4);
  EXPECT_NEAR(scan.time_s[0], 2.304e-6, 1e-9);
  EXPECT_NEAR(scan.time_s[1], (3 * 110.592 + 55.296) * 1e-6, 1e-9);
}

TEST(VelodynePacket, OtherSensors) {
  VelodyneBlocks blocks;
  blocks[2].azimuth = 18000;
  blocks[2].distance[3] = 1000;
  const Scan puck = DecodeVelodyne({VelodynePacket(blocks, kVlp32cId, 0x37, 0)});
  ASSERT_THAT(puck.points, SizeIs(1));
  EXPECT_NEAR(puck.points[0].z, -4.0 * std::sin(Radians(15.639)), 1e-5);
  // 1.4 deg before straight behind.
  EXPECT_NEAR(std::atan2(-puck.points[0].y, -puck.points[0].x), Radians(1.4), 1e-4);
  EXPECT_NEAR(puck.time_s[0], (2 * 55.296 + 2.304) * 1e-6, 1e-9);
  const Scan hdl = DecodeVelodyne({VelodynePacket(blocks, kHdl32eId, 0x37, 0)});
  EXPECT_NEAR(hdl.points.at(0).z, -2.0 * std::sin(Radians(8.0)), 1e-5);
  EXPECT_NEAR(hdl.time_s[0], (2 * 46.08 + 3 * 1.152) * 1e-6, 1e-9);
  EXPECT_THAT(
      MessageOf<InputError>([&] { DecodeVelodyne({VelodynePacket(blocks, 0x63, 0x37, 0)}); }),
      HasSubstr("a.pcap#1: packets of a Velodyne sensor that is not read (0x63)"));
  EXPECT_THAT(DecodeVelodyne({"no packet", std::string(1206, 'x')}).points, IsEmpty());
}

TEST(VelodynePacket, OfTwoReturnsBothUnlessTheyAreOne) {
  VelodyneBlocks blocks;
  blocks[0].distance[0] = 1000;
  blocks[1].distance[0] = 1000;
  blocks[2].distance[0] = 1000;
  blocks[3].distance[0] = 2000;
  const Scan scan = DecodeVelodyne({VelodynePacket(blocks, kVlp16Id, 0x39, 0)});
  ASSERT_THAT(scan.points, SizeIs(3));
  // Both of a pulse have its time.
  EXPECT_EQ(scan.time_s[1], scan.time_s[2]);
  EXPECT_NEAR(scan.time_s[1], 110.592e-6, 1e-9);
}

TEST(VelodynePacket, TimesAreThoseOfThePackets) {
  VelodyneBlocks blocks;
  blocks[0].distance[0] = 1000;
  const auto packet = [&](std::uint32_t us) { return VelodynePacket(blocks, kVlp16Id, 0x37, us); };
  // Received with some delay; over the full hour.
  EXPECT_NEAR(DecodeVelodyne({packet(100), packet(1427)}, {kPacketStamp, kPacketStamp + 3'000'000})
                  .time_s[1],
              0.001327, 1e-7);
  EXPECT_NEAR(
      DecodeVelodyne({packet(3599999900), packet(1227)}, {kPacketStamp, kPacketStamp + 1'300'000})
          .time_s[1],
      0.001327, 1e-7);
  // Of a sensor whose clock is set within the sweep.
  EXPECT_NEAR(
      DecodeVelodyne({packet(100), packet(900000000)}, {kPacketStamp, kPacketStamp + 1'300'000})
          .time_s[1],
      0.0013, 1e-7);
}

}  // namespace
}  // namespace lamina
