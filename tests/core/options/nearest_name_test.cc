#include "core/options/nearest_name.h"

#include <gtest/gtest.h>

namespace lamina {
namespace {

TEST(NearestName, CountsNeighboursThatHaveChangedPlacesOnce) {
  EXPECT_EQ(EditDistance("run", "run"), 0U);
  EXPECT_EQ(EditDistance("rnu", "run"), 1U);
  EXPECT_EQ(EditDistance("", "run"), 3U);
  EXPECT_EQ(EditDistance("run", ""), 3U);
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3U);
  EXPECT_EQ(EditDistance("exprot", "export"), 1U);
}

TEST(NearestName, LikelyNamesAreNear) {
  const std::vector<std::string> names{"run", "report", "register", "watch"};
  EXPECT_EQ(LikelyName("rnu", names), "run");
  EXPECT_EQ(LikelyName("regist", names), "register");
  EXPECT_EQ(LikelyName("wacth", names), "watch");
  EXPECT_EQ(LikelyName("fly", names), "");
  EXPECT_EQ(LikelyName("", names), "");
  EXPECT_EQ(LikelyName("run", {}), "");
  EXPECT_EQ(NearestName("fly", names), "run");
}

}  // namespace
}  // namespace lamina
