// Packets of an HDL-64E and the calibration that they need.
#include "io/packet/velodyne_hdl64e.h"
#include "core/base/angle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/base/error.h"
#include "io/packet/velodyne_packet.h"
#include "tests/support/files/velodyne_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

// Laser 3 of the upper block and laser 40 of the lower.
std::string Packet() {
  VelodyneBlocks blocks;
  for (std::size_t b = 0; b < blocks.size(); ++b) blocks[b].azimuth = 9000;
  blocks[0].distance[3] = 15000;
  blocks[0].intensity[3] = 50;
  blocks[3].distance[8] = 1000;
  std::string packet = VelodynePacket(blocks, 0x00, 0x00, 1000);
  for (std::size_t b = 1; b < blocks.size(); b += 2) packet.replace(100 * b, 2, "\xFF\xDD");
  return packet;
}

TEST(VelodyneHdl64e, PointsByTheCalibrationOfTheSensor) {
  const Hdl64eCalibration calibration = ParseHdl64eCalibration(Hdl64eXml(), "db.xml");
  EXPECT_TRUE(IsHdl64ePacket(Packet()));
  VelodyneDecoder decoder(&calibration);
  Scan scan;
  decoder.Add(Packet(), 5, "a.pcap#0", &scan);
  EXPECT_EQ(decoder.Describe(), "HDL-64E");
  ASSERT_THAT(scan.points, SizeIs(2));
  // 30 m and 1 m more, 3 deg up; the beam begins 20 cm above and 2.6 cm aside; 90 deg to the right,
  // less the laser's own 3 deg.
  const double up = Radians(3.0), turned = Radians(87.0);
  const double flat = 31.0 * std::cos(up) - 0.2 * std::sin(up);
  const double right = flat * std::sin(turned) - 0.026 * std::cos(turned);
  const double ahead = flat * std::cos(turned) + 0.026 * std::sin(turned);
  EXPECT_NEAR(scan.points[0].x, ahead, 1e-4);
  EXPECT_NEAR(scan.points[0].y, -right, 1e-4);
  EXPECT_NEAR(scan.points[0].z, 31.0 * std::sin(up) + 0.2 * std::cos(up), 1e-4);
  EXPECT_EQ(scan.points[0].intensity, 50.0F);
  EXPECT_NEAR(scan.time_s[0], 3 * 1.5e-6, 1e-9);
  // Near by its corrections are those measured there: between 0.9 and 1.1 m more.
  EXPECT_NEAR(std::hypot(scan.points[1].x, scan.points[1].y), 3.0 * std::cos(Radians(40)), 0.4);
  EXPECT_NEAR(scan.time_s[1], 48e-6 + 8 * 1.5e-6, 1e-9);
}

TEST(VelodyneHdl64e, WithoutCalibrationAClearError) {
  VelodyneDecoder decoder;
  Scan scan;
  try {
    decoder.Add(Packet(), 5, "a.pcap#0", &scan);
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("a.pcap#0"), HasSubstr("db.xml")));
  }
}

TEST(VelodyneHdl64e, CalibrationsThatCannotBeUsedSayWhy) {
  const std::string good = Hdl64eXml();
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  const auto expect = [&](const std::string& text, const std::string& reason) {
    try {
      ParseHdl64eCalibration(text, "db.xml");
      ADD_FAILURE() << "taken";
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("db.xml"), HasSubstr(reason)));
    }
  };
  expect("", "laser 0 is missing");
  expect(with("<id_>63", "<id_>64"), "64 is none of 0 to 63");
  expect(with("<id_>63", "<id_>62"), "laser 63 is missing");
  expect(with("vertCorrection_>", "other>"), "no <vertCorrection_>");
  expect(with("<distCorrection_>100", "<distCorrection_>x"), "must be a number");
  expect(with("<distCorrection_>100", "<distCorrection_>nan"), "must be a number");
  expect(with("<distLSB_>0.2", "<distLSB_>0"), "distLSB_");
  for (std::size_t bytes = 0; bytes + 100 < good.size(); bytes += good.size() / 50) {
    EXPECT_THROW(ParseHdl64eCalibration(good.substr(0, bytes), "db.xml"), InputError);
  }
}

}  // namespace
}  // namespace lamina
