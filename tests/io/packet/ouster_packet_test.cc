// Packets of Ouster's sensors: where their points are, for every profile, and what their metadata
// must say.
#include "io/packet/ouster_packet.h"
#include "core/base/angle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/base/error.h"
#include "tests/support/files/ouster_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

constexpr int kChannels = 16;

struct ProfileCase {
  std::string name;
  bool legacy = false;
  double unit_m = 0.001;
  OusterChannel channel;  // range 5000 units, of channel 3 alone, signal 77
};

std::string Word(std::uint32_t range, int i) { return Pack(i == 3 ? range : 0U); }

ProfileCase CaseOf(const std::string& name) {
  ProfileCase c;
  c.name = name;
  const auto u16 = [](int value) { return Pack(static_cast<std::uint16_t>(value)); };
  const auto u8 = [](int value) { return Pack(static_cast<std::uint8_t>(value)); };
  if (name == "LEGACY") {
    c.legacy = true;
    // The upper 12 bits are none of the range.
    c.channel = [=](int, int i) {
      return Word(0xABC01388U, i) + u16(9) + u16(77) + u16(5) + u16(6);
    };
  } else if (name == "RNG19_RFL8_SIG16_NIR16") {
    c.channel = [=](int, int i) {
      return Word(0xFFF81388U, i) + u16(9) + u16(77) + u16(5) + u16(6);
    };
  } else if (name == "RNG19_RFL8_SIG16_NIR16_DUAL") {
    // A second return at 6 m.
    c.channel = [=](int, int i) {
      return Word(0xFFF81388U, i) + Word(0x11001770U, i) + u16(77) + u16(78) + u16(5) + u16(6);
    };
  } else if (name == "RNG15_RFL8_NIR8") {
    c.unit_m = 0.008;
    c.channel = [=](int, int i) { return u16(i == 3 ? 0x9388 : 0) + u8(77) + u8(5); };
  } else {
    c.unit_m = 0.008;
    c.channel = [=](int, int i) {
      return u16(i == 3 ? 0x9388 : 0) + u8(77) + u8(5) + u16(i == 3 ? 6000 : 0) + u8(78) + u8(6);
    };
  }
  return c;
}

Scan DecodeOuster(const OusterSensor& sensor, const std::string& packet) {
  Scan scan;
  sensor.NewSweep()->Add(packet, 5, "a.pcap#0", &scan);
  return scan;
}

class OusterProfiles : public testing::TestWithParam<const char*> {};

TEST_P(OusterProfiles, PointsAreWhereTheBeamsHit) {
  const ProfileCase c = CaseOf(GetParam());
  const bool dual = c.name.find("DUAL") != std::string::npos;
  for (const bool sections : {false, true}) {
    const OusterSensor sensor(
        ParseOusterMetadata(OusterMetadataText(c.name, kChannels, sections), "a.json"));
    const std::string packet = OusterPacket(c.legacy, 5, 16, kChannels, c.channel);
    ASSERT_EQ(sensor.packet_bytes(), packet.size());
    EXPECT_EQ(sensor.PlaceOf(packet), 5U);
    const Scan scan = DecodeOuster(sensor, packet);
    const std::size_t returns = dual ? 2 : 1;
    ASSERT_THAT(scan.points, SizeIs(15 * returns));
    // Column 17: 17/64 of a turn clockwise from the back, 7 deg down, 3 deg to the side.
    const double theta = 2.0 * M_PI * (1.0 - 17.0 / 64.0);
    const double azimuth = theta - Radians(3.0), down = Radians(-7.0);
    for (std::size_t k = 0; k < returns; ++k) {
      const double r = (k == 0 ? 5000 : 6000) * c.unit_m - 0.02;
      const ScanPoint& p = scan.points[returns + k];
      EXPECT_NEAR(p.x, -(r * std::cos(azimuth) * std::cos(down) + 0.02 * std::cos(theta)), 1e-5);
      EXPECT_NEAR(p.y, -(r * std::sin(azimuth) * std::cos(down) + 0.02 * std::sin(theta)), 1e-5);
      EXPECT_NEAR(p.z, r * std::sin(down) + 0.036, 1e-5);
      EXPECT_EQ(p.intensity, 77.0F + static_cast<float>(k));
      EXPECT_NEAR(scan.time_s[returns + k], 1e-4, 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, OusterProfiles,
                         testing::Values("LEGACY", "RNG19_RFL8_SIG16_NIR16",
                                         "RNG19_RFL8_SIG16_NIR16_DUAL", "RNG15_RFL8_NIR8",
                                         "FUSA_RNG15_RFL8_NIR8_DUAL"),
                         [](const auto& test) { return std::string(test.param); });

TEST(OusterPacket, FramesAreSweepsAlsoWhenTheirNumbersBeginAgain) {
  const OusterSensor sensor(
      ParseOusterMetadata(OusterMetadataText("LEGACY", kChannels, false), "a.json"));
  EXPECT_FALSE(sensor.BeginsSweep(7, 7));
  EXPECT_TRUE(sensor.BeginsSweep(7, 8));
  EXPECT_TRUE(sensor.BeginsSweep(65535, 0));
  EXPECT_FALSE(sensor.BeginsSweep(8, 7)) << "a late packet";
}

TEST(OusterPacket, PacketsOfAnotherLengthAreNone) {
  const ProfileCase c = CaseOf("RNG15_RFL8_NIR8");
  const OusterSensor sensor(
      ParseOusterMetadata(OusterMetadataText(c.name, kChannels, true), "a.json"));
  const std::string packet = OusterPacket(false, 5, 0, kChannels, c.channel);
  for (const std::size_t bytes : {std::size_t{0}, std::size_t{1}, packet.size() - 1}) {
    EXPECT_FALSE(sensor.PlaceOf(packet.substr(0, bytes)));
    EXPECT_TRUE(DecodeOuster(sensor, packet.substr(0, bytes)).points.empty());
  }
  EXPECT_TRUE(MayBeOusterPacket(packet));
  EXPECT_FALSE(MayBeOusterPacket(packet + "x"));
  // Columns beyond the frame, and of another clock.
  std::string wrong = packet;
  wrong[32 + 8] = '\xFF';
  EXPECT_THAT(DecodeOuster(sensor, wrong).points, SizeIs(14));
  wrong = packet;
  wrong[32 + 12 + 4 * kChannels + 7] = '\x70';
  EXPECT_THAT(DecodeOuster(sensor, wrong).points, SizeIs(14));
}

TEST(OusterPacket, MetadataThatCannotBeUsedSayWhy) {
  const std::string good = OusterMetadataText("RNG15_RFL8_NIR8", kChannels, true);
  const auto expect = [&](const std::string& text, const std::string& reason) {
    try {
      ParseOusterMetadata(text, "a.json");
      ADD_FAILURE() << "taken: " << text;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("a.json"), HasSubstr(reason)));
    }
  };
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  expect("", "no JSON object");
  expect("[1]", "no JSON object");
  expect(std::string(100000, '['), "no JSON object");
  expect("{}", "lidar_mode");
  expect(with("RNG15_RFL8_NIR8", "RNG99"), "'RNG99' are not read");
  expect(with("beam_altitude", "other"), "beam_altitude_angles");
  expect(with("[-10, ", "["), "a list of 16 numbers");
  expect(with("[-10, ", "[\"x\", "), "a list of 16 numbers");
  expect(with("[-10, ", "[1e999, "), "");
  expect(with("\"columns_per_frame\": 64", "\"columns_per_frame\": 0"), "columns_per_frame");
  expect(with("\"columns_per_packet\": 16", "\"columns_per_packet\": 99999"), "columns_per_packet");
  expect(with("\"pixels_per_column\": 16", "\"pixels_per_column\": 17"), "a list of 17 numbers");
  expect(with("[-1, 0", "[-5, 0"), "no rotation");
  for (std::size_t bytes = 1; bytes < good.size(); bytes += 7) {
    EXPECT_THROW(ParseOusterMetadata(good.substr(0, bytes), "a.json"), InputError);
  }
}

}  // namespace
}  // namespace lamina
