// Localisation without a start, tried on generated drives: a short form of the trials, and what is
// told of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "tools/localise/report.h"
#include "tools/localise/trial.h"

namespace lamina {
namespace {

using ::testing::HasSubstr;

WindowResult Claimed(double after_s, bool right) {
  WindowResult window;
  window.claimed = true;
  window.right = right;
  window.after_s = after_s;
  return window;
}

TEST(LocalisationReport, CountsWhatIsInTimeLaterWrongAndWhyNot) {
  LocalisationTrial trial;
  trial.name = "square";
  WindowResult missed;
  missed.stage = "others fit as well";
  WindowResult elsewhere = Claimed(2.0, false);
  elsewhere.kind = WindowKind::kElsewhere;
  trial.windows = {Claimed(2.0, true), Claimed(4.9, true), Claimed(5.4, true), missed, elsewhere};
  EXPECT_EQ(WrongClaims({trial}), 1u);
  EXPECT_THAT(LocalisationTable({trial}),
              HasSubstr("| square | 1 | 4 | 2 (50 %) | 1 | 1 | 1 | 1 others fit as well |"));
  const std::string csv = WindowsCsv({trial});
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 6);
}

TEST(LocalisationTrial, ASensorThatIsLostWhileItMapsIsFoundWhereItHasBeenAndNowhereElse) {
  const LocalisationCase hall = {
      "hall",        "handheld", "--scene hall --sensor vlp16 --points 14400 --frames 110",
      "--speed 1.5", 5.0,        "--scene room --sensor vlp16 --points 14400 --frames 100"};
  LocalisationTrialOptions options;
  options.lost = true;
  options.on_map = 1;
  options.off_map = 0;
  options.window_s = 4.0;
  options.elsewhere = 1;
  const LocalisationTrial trial = RunLocalisationTrial(hall, 1, options);
  ASSERT_EQ(trial.windows.size(), 2u);
  EXPECT_EQ(WrongClaims({trial}), 0u);
  EXPECT_TRUE(trial.windows[0].right) << trial.windows[0].stage;
  EXPECT_FALSE(trial.windows[1].claimed);
}

TEST(LocalisationTrial, WindowsOfAnotherVisitAreFoundAndThoseOfAnotherPlaceAreNot) {
  const LocalisationCase hall = {
      "hall",        "handheld", "--scene hall --sensor vlp16 --points 14400 --frames 110",
      "--speed 1.5", 5.0,        "--scene room --sensor vlp16 --points 14400 --frames 100"};
  LocalisationTrialOptions options;
  options.on_map = 2;
  options.off_map = 0;
  options.window_s = 4.0;
  options.elsewhere = 1;
  const LocalisationTrial trial = RunLocalisationTrial(hall, 1, options);
  ASSERT_EQ(trial.windows.size(), 3u);
  EXPECT_LT(trial.map_error_m, 0.1);
  EXPECT_EQ(WrongClaims({trial}), 0u);
  for (std::size_t i = 0; i < 2; ++i) {
    const WindowResult& window = trial.windows[i];
    EXPECT_TRUE(window.right) << i << ": " << window.stage;
    EXPECT_LT(window.error_m, 0.1);
    EXPECT_FALSE(window.compared.empty());
  }
  EXPECT_FALSE(trial.windows[2].claimed);
}

}  // namespace
}  // namespace lamina
