#include "io/points/point_times.h"

#include <cmath>

#include "tests/support/io_test_files.h"

namespace lamina {
namespace {

using TimeUnit = PointTimeUnit;
using testing::FloatNear;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;

PointTimes Convert(const std::vector<RawTime>& raw, TimeUnit unit = TimeUnit::kAuto,
                   bool is_float32 = false) {
  return ConvertPointTimes(raw, is_float32, unit, "f.pcd: field 't'");
}

TEST(PointTimes, UnitOfATenthOfASecondIsFound) {
  for (const RawTime tenth : {0.1L, 100.0L, 1e5L, 1e8L}) {
    const PointTimes times = Convert({0.0L, tenth, tenth / 2});
    EXPECT_EQ(times.stamp_ns, 0);
    EXPECT_THAT(times.time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.1F, 0.05F}));
  }
}

TEST(PointTimes, OffsetsStayAsTheyAre) {
  EXPECT_THAT(Convert({-0.1L, 0.0L}).time_s, Pointwise(FloatNear(1e-6F), {-0.1F, 0.0F}));
  EXPECT_THAT(Convert({5.0L, 5.1L}).time_s, Pointwise(FloatNear(1e-6F), {5.0F, 5.1F}));
}

TEST(PointTimes, EpochStampsAreExactInEveryUnit) {
  const StampNs stamp = 1700000000123456789;
  const auto first = static_cast<RawTime>(stamp);
  for (const RawTime ns_per_unit : {1e9L, 1e6L, 1e3L, 1.0L}) {
    const PointTimes times = Convert({(first + 5e7L) / ns_per_unit, first / ns_per_unit});
    EXPECT_EQ(times.stamp_ns, stamp);
    EXPECT_THAT(times.time_s, Pointwise(FloatNear(1e-6F), {0.05F, 0.0F}));
  }
}

TEST(PointTimes, EpochDecidesWhereTheSpanIsAmbiguous) {
  const PointTimes times = Convert({1.7e9L, 1.7e9L + 5.0L});
  EXPECT_EQ(times.stamp_ns, 1700000000000000000);
  EXPECT_FLOAT_EQ(times.time_s[1], 5.0F);
}

TEST(PointTimes, TimeSinceBootIsAClock) {
  const PointTimes times = Convert({1e12L, 1e12L + 1e8L});
  EXPECT_EQ(times.stamp_ns, 1000000000000);
  EXPECT_FLOAT_EQ(times.time_s[1], 0.1F);
}

TEST(PointTimes, GivenUnitOverridesTheSpan) {
  const PointTimes times = Convert({0.0L, 1e8L}, TimeUnit::kMicroseconds);
  EXPECT_FLOAT_EQ(times.time_s[1], 100.0F);
  EXPECT_FLOAT_EQ(Convert({0.0L, 3.0L}, TimeUnit::kMilliseconds).time_s[1], 0.003F);
}

TEST(PointTimes, ConstantFieldTellsNothingButItsClock) {
  EXPECT_THAT(Convert({0.0L, 0.0L}).time_s, IsEmpty());
  const PointTimes times = Convert({1.7e18L, 1.7e18L});
  EXPECT_THAT(times.time_s, IsEmpty());
  EXPECT_EQ(times.stamp_ns, 1700000000000000000);
}

TEST(PointTimes, Float32TooCoarseForItsSpanTellsNothing) {
  const PointTimes times = Convert({1.7e9L, 1.7e9L + 128.0L}, TimeUnit::kAuto, true);
  EXPECT_THAT(times.time_s, IsEmpty());
  EXPECT_EQ(times.stamp_ns, 0);
}

TEST(PointTimes, ValuesThatAreNotFiniteGetZero) {
  const PointTimes times = Convert({0.0L, std::nanl(""), 0.1L});
  EXPECT_THAT(times.time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.0F, 0.1F}));
  EXPECT_THAT(Convert({std::nanl("")}).time_s, IsEmpty());
}

TEST(PointTimes, SpanThatFitsNoUnitAsksForTheOption) {
  EXPECT_THAT(MessageOf<InputError>([] {
                Convert({0.0L, 1e12L});
              }),
              testing::AllOf(HasSubstr("f.pcd: field 't'"), HasSubstr("point_time_unit")));
}

TEST(PointTimes, TimesBeyond64BitsAreRefused) {
  EXPECT_THAT(MessageOf<InputError>([] {
                Convert({0.0L, 1e30L}, TimeUnit::kSeconds);
              }),
              HasSubstr("does not fit"));
}

}  // namespace
}  // namespace lamina
