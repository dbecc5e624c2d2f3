// What a session of a configuration that was named says of points' times that mislead.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/program/watch_scenes.h"
#include "tests/support/scenes/swept_drive.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class WatchTimesTest : public WatchTest {
 protected:
  // What a session of these scans says, whose times are `per_s` a second.
  std::string Watch(const SweptDrive& drive, double per_s, const Arguments& more = {}) {
    std::filesystem::remove_all(Path("in"));
    std::filesystem::remove_all(Path("session"));
    for (std::size_t i = 0; i < drive.size(); ++i) {
      // With recorded stamps: by made-up ones a sweep is taken to last as long as they are apart.
      const std::int64_t stamp_ns = 1'700'000'000'000'000'000 + 100'000'000 * std::int64_t(i);
      Write("in/" + std::to_string(stamp_ns) + ".pcd", TimedPcd(drive.Read(i), 0.0, per_s));
    }
    Arguments arguments{"--config", "default", "--set", "scans.point_time_unit=s"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Once(arguments).err;
  }
};

TEST_F(WatchTimesTest, AreToldAndUsedAllTheSame) {
  const SweptDrive drive(22, false);
  EXPECT_THAT(Watch(drive, 1.0), Not(HasSubstr("This session deskews")));
  // A unit that is none: each sweep seems to be a quarter of a second long.
  EXPECT_THAT(Watch(drive, 2.5),
              AllOf(HasSubstr("times are understood wrongly"), HasSubstr("mm as they are"),
                    HasSubstr("preparation.deskew=off, or tell the unit")));
  const std::string told = Bytes(Path("session/trajectory_tum.txt"));
  EXPECT_THAT(Once({"--config", "default", "--set", "scans.point_time_unit=s"}).err,
              Not(HasSubstr("This session deskews")))
      << "once is enough";
  // Nothing is decided by it: not to look gives the same bytes.
  EXPECT_THAT(Watch(drive, 2.5, {"--set", "preparation.deskew=time"}),
              Not(HasSubstr("This session deskews")));
  EXPECT_TRUE(Bytes(Path("session/trajectory_tum.txt")) == told);
}

TEST_F(WatchTimesTest, AreMissedWhereScansAreSweeps) {
  const SweptDrive drive(22, false);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    Write("in/" + std::to_string(100 + i) + ".bin", KittiBin(drive.Read(i).points));
  }
  EXPECT_THAT(Once({"--config", "default"}).err,
              AllOf(HasSubstr("sweeps that are not compensated for motion"),
                    HasSubstr("This session does not deskew them")));
}

TEST_F(WatchTimesTest, OfCompensatedCloudsAreTold) {
  EXPECT_THAT(Watch(SweptDrive(22, true), 1.0, {"--done", "move"}),
              AllOf(HasSubstr("compensated for motion already"),
                    HasSubstr("begin another one with --set preparation.deskew=off")));
}

}  // namespace
}  // namespace lamina
