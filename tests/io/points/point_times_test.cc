#include "io/points/point_times.h"

#include <cmath>
#include <cstdint>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using TimeUnit = PointTimeUnit;
using testing::ElementsAre;
using testing::FloatNear;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;

template <typename T = double>
PointTimes Convert(const std::vector<T>& raw, TimeUnit unit = TimeUnit::kAuto) {
  return ConvertPointTimes(raw, unit, "f.pcd: field 't'");
}

TEST(PointTimes, UnitOfATenthOfASecondIsFound) {
  for (const double tenth : {0.1, 100.0, 1e5, 1e8}) {
    const PointTimes times = Convert({0.0, tenth, tenth / 2});
    EXPECT_EQ(times.stamp_ns, 0);
    EXPECT_THAT(times.time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.1F, 0.05F}));
  }
}

TEST(PointTimes, OffsetsStayAsTheyAre) {
  EXPECT_THAT(Convert({-0.1, 0.0}).time_s, Pointwise(FloatNear(1e-6F), {-0.1F, 0.0F}));
  EXPECT_THAT(Convert({0.9, 1.0}).time_s, Pointwise(FloatNear(1e-6F), {0.9F, 1.0F}));
}

// No sensor is so late: since it was switched on, or since the recording began.
TEST(PointTimes, WhatIsFartherThanASecondFromTheStampIsAClock) {
  const PointTimes times = Convert({5.0, 5.1});
  EXPECT_EQ(times.stamp_ns, 5'000'000'000);
  EXPECT_THAT(times.time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.1F}));
}

TEST(PointTimes, AFewDamagedValuesAreNoTimes) {
  std::vector<double> raw;
  for (int i = 0; i < 1000; ++i) raw.push_back(1700000000.0 + 1e-4 * i);
  raw[0] = 0.0;
  raw[500] += 30.0;
  raw[999] = 1e300;
  const PointTimes times = Convert(raw);
  EXPECT_STREQ(times.unit, "s");
  EXPECT_NEAR(static_cast<double>(times.stamp_ns - 1700000000'000'100'000), 0.0, 300.0);
  for (const std::size_t i : {0, 500, 999}) EXPECT_TRUE(std::isnan(times.time_s[i])) << i;
  EXPECT_NEAR(times.time_s[998], 0.0997, 1e-5);
  // One among zeros does not make them times.
  std::vector<float> zeros(1000, 0.0F);
  zeros[10] = 0.9F;
  EXPECT_THAT(Convert(zeros).time_s, IsEmpty());
}

TEST(PointTimes, WholeEpochStampsAreExactInEveryUnit) {
  const std::int64_t stamp = 1700000000123456789;
  for (const std::int64_t ns_per_unit : {1, 1000, 1000000}) {
    const std::int64_t first = stamp / ns_per_unit, apart = 50000000 / ns_per_unit;
    const PointTimes times = Convert<std::int64_t>({first + apart, first});
    EXPECT_EQ(times.stamp_ns, first * ns_per_unit);
    EXPECT_THAT(times.time_s, ElementsAre(0.05F, 0.0F));
    const auto unsigned_first = static_cast<std::uint64_t>(first);
    const PointTimes same = Convert<std::uint64_t>(
        {unsigned_first + static_cast<std::uint64_t>(apart), unsigned_first});
    EXPECT_EQ(same.stamp_ns, first * ns_per_unit);
    EXPECT_THAT(same.time_s, ElementsAre(0.05F, 0.0F));
  }
}

// In seconds a double holds an epoch to 0.24 us: times are what is between the values, to the last
// digit, and stamp and times together are the value.
TEST(PointTimes, EpochsInDoublesLoseNothingButWhatTheyLack) {
  const double first = 1700000000.1234567, second = first + 0.1;
  for (const double per_s : {1.0, 1e3, 1e6}) {
    const double a = first * per_s, b = second * per_s;
    const PointTimes times = Convert<double>({b, a});
    EXPECT_NEAR(static_cast<double>(times.stamp_ns - 1700000000000000000), 123456700.0, 300.0);
    EXPECT_NEAR(times.time_s[0], (b - a) / per_s, 1e-8);
    EXPECT_NEAR(times.time_s[1], 0.0, 1e-9);
  }
}

TEST(PointTimes, FloatsInSecondsStayTheirBits) {
  const std::vector<float> values = {-0.0333333F, 0.0F, 1e-8F, 0.0666667F};
  EXPECT_EQ(Convert<float>(values).time_s, values);
}

TEST(PointTimes, OffsetsInNanosecondsAreTheNearestFloats) {
  const PointTimes times = Convert<std::uint32_t>({0, 33333333, 99999999});
  EXPECT_EQ(times.stamp_ns, 0);
  EXPECT_THAT(times.time_s, ElementsAre(0.0F, 0.033333333F, 0.099999999F));
}

TEST(PointTimes, EpochDecidesWhereTheSpanIsAmbiguous) {
  const PointTimes times = Convert({1.7e9, 1.7e9 + 5.0});
  EXPECT_EQ(times.stamp_ns, 1700000000000000000);
  EXPECT_FLOAT_EQ(times.time_s[1], 5.0F);
}

TEST(PointTimes, TimeSinceBootIsAClock) {
  const PointTimes times = Convert({1e12, 1e12 + 1e8});
  EXPECT_EQ(times.stamp_ns, 1000000000000);
  EXPECT_FLOAT_EQ(times.time_s[1], 0.1F);
}

TEST(PointTimes, GivenUnitOverridesTheSpan) {
  const PointTimes times = Convert({0.0, 1e8}, TimeUnit::kMicroseconds);
  EXPECT_FLOAT_EQ(times.time_s[1], 100.0F);
  EXPECT_FLOAT_EQ(Convert({0.0, 3.0}, TimeUnit::kMilliseconds).time_s[1], 0.003F);
}

TEST(PointTimes, ConstantFieldTellsNothingButItsClock) {
  EXPECT_THAT(Convert({0.0, 0.0}).time_s, IsEmpty());
  const PointTimes times = Convert({1.7e18, 1.7e18});
  EXPECT_THAT(times.time_s, IsEmpty());
  EXPECT_EQ(times.stamp_ns, 1700000000000000000);
}

TEST(PointTimes, Float32TooCoarseForItsSpanTellsNothing) {
  const PointTimes times = Convert<float>({1.7e9F, 1.7e9F + 128.0F});
  EXPECT_THAT(times.time_s, IsEmpty());
  EXPECT_EQ(times.stamp_ns, 0);
}

TEST(PointTimes, ValuesThatAreNotFiniteAreNoTimes) {
  const PointTimes times = Convert({0.0, std::nan(""), 0.1});
  ASSERT_EQ(times.time_s.size(), 3U);
  EXPECT_TRUE(std::isnan(times.time_s[1]));
  EXPECT_FLOAT_EQ(times.time_s[2], 0.1F);
  EXPECT_THAT(Convert({std::nan("")}).time_s, IsEmpty());
}

TEST(PointTimes, SpanThatFitsNoUnitAsksForTheOption) {
  EXPECT_THAT(MessageOf<InputError>([] {
                Convert({0.0, 1e12});
              }),
              testing::AllOf(HasSubstr("f.pcd: field 't'"), HasSubstr("point_time_unit")));
}

TEST(PointTimes, TimesBeyond64BitsAreRefused) {
  EXPECT_THAT(MessageOf<InputError>([] {
                Convert({0.0, 1e30}, TimeUnit::kSeconds);
              }),
              HasSubstr("does not fit"));
}

}  // namespace
}  // namespace lamina
