#include "core/options/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "core/map/voxel_map.h"

namespace lamina {
namespace {

using testing::HasSubstr;

struct InnerOptions {
  int count = 3;
  void Visit(OptionVisitor& v) { v.Integer("count", &count, 1, 10); }
};

struct OuterOptions {
  enum class Mode { kSlow, kFast };
  double ratio = 0.5;
  bool flag = false;
  Mode mode = Mode::kFast;
  InnerOptions inner;
  double after = 2.0;
  void Visit(OptionVisitor& v) {
    v.Number("ratio", &ratio, 0.25, 0.75);
    v.Flag("flag", &flag);
    v.EnumChoice("mode", &mode, {"slow", "fast"});
    v.Group("inner", &inner);
    v.Number("after", &after, 0.0, 4.0);
  }
};

// What the check says of options changed in one way; empty if they pass.
std::string Complaint(const std::function<void(OuterOptions*)>& change) {
  OuterOptions options;
  change(&options);
  try {
    CheckOptions(options, "top");
  } catch (const OptionError& error) {
    return error.what();
  }
  return "";
}

TEST(Options, WhatIsDerivedIsBroughtBackIntoRange) {
  OuterOptions options;
  options.ratio *= 2.0;
  options.inner.count *= -2;
  const OuterOptions derived = WithinRange(options);
  EXPECT_EQ(derived.ratio, 0.75);
  EXPECT_EQ(derived.inner.count, 1);
  EXPECT_EQ(derived.after, options.after);
  EXPECT_NO_THROW(CheckOptions(derived, ""));
}

TEST(Options, DefaultsAndEndsOfTheRangePass) {
  EXPECT_EQ(Complaint([](OuterOptions*) {}), "");
  EXPECT_EQ(Complaint([](OuterOptions* o) { o->ratio = 0.25; }), "");
  EXPECT_EQ(Complaint([](OuterOptions* o) { o->ratio = 0.75; }), "");
  EXPECT_EQ(Complaint([](OuterOptions* o) { o->inner.count = 10; }), "");
}

TEST(Options, OutOfRangeNamesOptionValueAndRange) {
  const std::string number = Complaint([](OuterOptions* o) { o->ratio = 0.875; });
  EXPECT_THAT(number, HasSubstr("top.ratio"));
  EXPECT_THAT(number, HasSubstr("0.875"));
  EXPECT_THAT(number, HasSubstr("[0.25, 0.75]"));
  const std::string integer = Complaint([](OuterOptions* o) { o->inner.count = 0; });
  EXPECT_THAT(integer, HasSubstr("top.inner.count"));
  EXPECT_THAT(integer, HasSubstr("= 0"));
  EXPECT_THAT(integer, HasSubstr("[1, 10]"));
  // The name is right again after a group has ended.
  EXPECT_THAT(Complaint([](OuterOptions* o) { o->after = -1.0; }), HasSubstr("top.after"));
  EXPECT_THAT(Complaint([](OuterOptions* o) { o->mode = static_cast<OuterOptions::Mode>(2); }),
              HasSubstr("top.mode"));
}

TEST(Options, NanAndInfinityAreOutOfRange) {
  using Limits = std::numeric_limits<double>;
  EXPECT_THAT(Complaint([](OuterOptions* o) { o->ratio = Limits::quiet_NaN(); }),
              HasSubstr("top.ratio"));
  EXPECT_THAT(Complaint([](OuterOptions* o) { o->ratio = Limits::infinity(); }),
              HasSubstr("top.ratio"));
}

TEST(Options, AlgorithmsRefuseBadOptionsWhenMade) {
  VoxelMapOptions options;
  options.root_size_m = 0.0;
  EXPECT_THROW(VoxelMap{options}, OptionError);
}

}  // namespace
}  // namespace lamina
