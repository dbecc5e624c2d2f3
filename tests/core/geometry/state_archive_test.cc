#include "core/geometry/state_archive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

enum class Colour : std::uint8_t { kRed, kGreen };

// Everything that an archive can take.
struct Everything {
  bool flag = false;
  std::int8_t small = 0;
  std::uint64_t large = 0;
  double real = 0.0;
  float single = 0.0F;
  Colour colour = Colour::kRed;
  Eigen::Vector3d vector = Eigen::Vector3d::Zero();
  Matrix6d matrix = Matrix6d::Zero();
  std::string text;
  std::vector<std::int32_t> numbers;
  std::vector<Colour> colours;
  std::vector<std::string> texts;
  std::deque<SE3> poses;
  StampedPose stamped;
  PointCluster cluster;
  std::vector<TimedCluster> timed;

  void Archive(StateArchive& a) {
    a(&flag, &small, &large, &real, &single, &colour, &vector, &matrix);
    a(&text, &numbers, &colours, &texts, &poses, &stamped, &cluster, &timed);
  }
};

std::string BytesOf(Everything value) {
  StateArchive a;
  a(&value);
  return a.written();
}

Everything Filled() {
  Draws draws(1);
  Everything e;
  e.flag = true;
  e.small = -5;
  e.large = 0xfedcba9876543210U;
  e.real = -0.0;
  e.single = std::numeric_limits<float>::denorm_min();
  e.colour = Colour::kGreen;
  e.vector = {std::nan(""), std::numeric_limits<double>::infinity(), 1e-310};
  e.matrix = Matrix6d::Random();
  e.text = std::string("a\0b\n\xff", 5);
  e.numbers = {1, -2, std::numeric_limits<std::int32_t>::min()};
  e.colours = {Colour::kGreen, Colour::kRed};
  e.texts = {"", "x", std::string(1000, 'y')};
  for (int i = 0; i < 3; ++i) e.poses.push_back(draws.Pose(1e5));
  e.poses.front().q.coeffs() *= 1.0 + 1e-13;  // must not be normalised on the way
  e.stamped = {-7, draws.Pose(1.0)};
  e.cluster = ClusterOf(draws.Cloud(10, {1.0, 2.0, 3.0}, 1.0));
  TimedCluster timed;
  timed.points = e.cluster;
  timed.mean_time_s = 0.05;
  timed.time_scatter = 1e-3;
  timed.point_time = {1.0, 2.0, 3.0};
  e.timed = {timed, TimedCluster(), timed};
  return e;
}

TEST(StateArchive, WhatIsReadBackHasTheSameBytesAndReplacesWhatWasThere) {
  for (const Everything& written : {Filled(), Everything()}) {
    for (Everything read : {Filled(), Everything()}) {
      const std::string bytes = BytesOf(written);
      StateArchive a{std::string_view(bytes)};
      EXPECT_TRUE(a.reading());
      a(&read);
      EXPECT_EQ(a.unread(), 0U);
      EXPECT_EQ(BytesOf(read), bytes);
      EXPECT_EQ(read.texts, written.texts);
      EXPECT_EQ(read.numbers, written.numbers);
      EXPECT_EQ(read.poses.size(), written.poses.size());
      EXPECT_EQ(read.timed.size(), written.timed.size());
    }
  }
}

TEST(StateArchive, BytesAreLittleEndianAndWithoutPadding) {
  StateArchive a;
  std::uint16_t number = 0x0201;
  std::string text = "xy";
  std::vector<std::uint8_t> list = {7};
  a(&number, &text, &list);
  EXPECT_EQ(a.written(), std::string("\1\2"
                                     "\2\0\0\0\0\0\0\0"
                                     "xy"
                                     "\1\0\0\0\0\0\0\0"
                                     "\7",
                                     21));
}

TEST(StateArchive, BytesThatEndTooEarlyAreAnErrorWhereverTheyEnd) {
  const std::string bytes = BytesOf(Filled());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    StateArchive a{std::string_view(bytes).substr(0, size)};
    Everything read;
    EXPECT_THROW(a(&read), InputError) << size << " bytes of " << bytes.size();
  }
}

// A damaged length must not make anyone allocate what is not there.
TEST(StateArchive, LengthsBeyondTheBytesAreAnError) {
  for (const std::uint64_t length : {std::uint64_t{9}, std::uint64_t{1} << 40, ~std::uint64_t{0}}) {
    StateArchive writer;
    std::uint64_t count = length, filling = 0;
    writer(&count, &filling);
    const std::string bytes = writer.written();
    const auto read = [&](auto value) {
      StateArchive a{std::string_view(bytes)};
      a(&value);
    };
    EXPECT_THROW(read(std::string()), InputError);
    EXPECT_THROW(read(std::vector<std::int32_t>()), InputError);
    EXPECT_THROW(read(std::vector<std::string>()), InputError);
    EXPECT_THROW(read(std::deque<SE3>()), InputError);
    StateArchive a{std::string_view(bytes)};
    EXPECT_THROW(a.Size(0, 0), InputError);
  }
}

TEST(StateArchive, NumbersThatFitTheirBytesByCountAloneAreAnError) {
  StateArchive writer;
  std::uint64_t count = 8, filling = 0;  // eight numbers of eight bytes, and only eight bytes
  writer(&count, &filling);
  std::vector<double> numbers;
  StateArchive a{std::string_view(writer.written())};
  EXPECT_THROW(a(&numbers), InputError);
}

}  // namespace
}  // namespace lamina
