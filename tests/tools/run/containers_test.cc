// The same scans give the same trajectory, whatever they came in.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "io/map/map_io.h"
#include "tests/support/files/container_files.h"
#include "tests/support/files/swept_messages.h"
#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ContainersTest : public RunTest {
 protected:
  static std::string Pcd(const Scan& scan) {
    const std::string count = std::to_string(scan.points.size());
    std::string bytes =
        "VERSION 0.7\nFIELDS x y z intensity t\nSIZE 4 4 4 4 4\nTYPE F F F F F\nCOUNT 1 1 1 1 1\n"
        "WIDTH " +
        count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      bytes += Pack(scan.points[i], scan.time_s[i]);
    }
    return bytes;
  }
  std::string TrajectoryOf(const std::string& scans, const std::vector<std::string>& more = {}) {
    const Outcome outcome = Run(scans, more);
    EXPECT_THAT(outcome.err, HasSubstr("times in field 't' in s"));
    return Bytes(Path("out/trajectory_tum.txt")) + Bytes(Path("out/map_surfels.ply"));
  }
};

TEST_F(ContainersTest, GiveTheSameTrajectoryByteForByte) {
  for (const Scan& scan : SweptScans()) {
    Write("folder/" + std::to_string(scan.stamp_ns) + ".pcd", Pcd(scan));
  }
  const std::string expected = TrajectoryOf(Path("folder"));
  EXPECT_GT(expected.size(), 1000U);
  const RecordedMessages ros1 = SweptMessages(WireWriter::Form::kRos1);
  const RecordedMessages cdr = SweptMessages(WireWriter::Form::kCdr);
  EXPECT_EQ(TrajectoryOf(Write("a.bag", BagBytes(ros1, {"lz4", 4, true}))), expected);
  EXPECT_EQ(TrajectoryOf(Write("b.bag", BagBytes(ros1, {"bz2", 4, false}))), expected);
  EXPECT_EQ(TrajectoryOf(Write("a.mcap", McapBytes(cdr, {}))), expected);
  EXPECT_EQ(TrajectoryOf(Write("b.mcap", McapBytes(ros1, {"lz4", 5, false, true, true})),
                         {"--threads", "1"}),
            expected);
  std::filesystem::create_directories(Path("bag"));
  WriteDatabase(Path("bag/bag_0.db3"), cdr);
  Write("bag/metadata.yaml", Metadata({"bag_0.db3"}));
  EXPECT_EQ(TrajectoryOf(Path("bag")), expected);
}

TEST_F(ContainersTest, ATopicIsChosenAndKeptForLater) {
  const std::string bag =
      Write("a.bag", BagBytes(SweptMessages(WireWriter::Form::kRos1, "/rear"), {"lz4", 4, true}));
  EXPECT_THAT(Lamina({"run", "--scans", bag, "--out", Path("none")}).err,
              AllOf(HasSubstr("2 topics of scans"), HasSubstr("--topic")));
  Run(bag, {"--topic", "/rear"});
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("topic: \"/rear\""));
  const Outcome cloud =
      Lamina({"export", "--run", Path("out"), "--scans", bag, "--resolution", "0.5"});
  EXPECT_EQ(cloud.code, 0) << cloud.err;
  const Outcome doctor = Lamina({"doctor", "--run", Path("out"), "--scans", bag});
  EXPECT_EQ(doctor.code, 0) << doctor.err;
}

// A run that knew its scans by themselves, and a recording of them beside others.
TEST_F(ContainersTest, ATopicIsChosenForTheRunOfAnotherContainer) {
  Run(Write("one.bag", BagBytes(SweptMessages(WireWriter::Form::kRos1), {"lz4", 4, true})));
  const std::string two =
      Write("two.bag", BagBytes(SweptMessages(WireWriter::Form::kRos1, "/rear"), {"lz4", 4, true}));
  const std::vector<std::string> exporting = {"export", "--run",        Path("out"), "--scans",
                                              two,      "--resolution", "0.5"};
  const std::vector<std::string> examining = {"doctor", "--run", Path("out"), "--scans", two};
  for (std::vector<std::string> words : {exporting, examining}) {
    EXPECT_THAT(Lamina(words).err, HasSubstr("choose one by --topic"));
    words.insert(words.end(), {"--topic", "/points"});
    EXPECT_EQ(Lamina(words).code, 0) << Lamina(words).err;
  }
}

TEST_F(ContainersTest, InfoTellsWhatIsInside) {
  RecordedMessages recorded = SweptMessages(WireWriter::Form::kRos1, "/rear");
  // Two scans are missing on one topic.
  std::size_t seen = 0;
  for (auto it = recorded.messages.begin(); it != recorded.messages.end();) {
    seen += it->topic == 1 ? 1 : 0;
    it = it->topic == 1 && (seen == 5 || seen == 6) ? recorded.messages.erase(it) : it + 1;
  }
  const std::string bag = Write("a b.bag", BagBytes(recorded, {"lz4", 4, true}));
  const Outcome info = Lamina({"info", bag});
  EXPECT_EQ(info.code, 0) << info.err;
  EXPECT_THAT(info.out,
              AllOf(HasSubstr("a ROS 1 bag"), HasSubstr("sensor_msgs/Imu"),
                    HasSubstr("12 messages, 10 Hz, scans"), HasSubstr("frame   lidar"),
                    HasSubstr("fields  x y z intensity t (float32)"),
                    HasSubstr("times in field 't' in s, -0.05"), HasSubstr("16 rings"),
                    HasSubstr("12 scans over 1.100 s, 10 Hz, no gap"),
                    HasSubstr("10 scans over 1.100 s, 10 Hz; 1 gap, 2 scans missing, the longest "
                              "0.300 s after scan 3"),
                    HasSubstr("lamina run --scans '" + bag + "' --topic /points --out out")));
  EXPECT_THAT(Lamina({"info", bag, "--topic", "/rear"}).out, testing::Not(HasSubstr("missing")));
  RecordedMessages imu;
  imu.topics = {{"/imu", "sensor_msgs/Imu"}};
  imu.messages = {{0, 5, "imu"}};
  const Outcome none = Lamina({"info", Write("imu.mcap", McapBytes(imu, {}))});
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.out, HasSubstr("topic   /imu  sensor_msgs/Imu  1 messages"));
  EXPECT_THAT(none.err, HasSubstr("holds no scans"));
  const Outcome folder = Lamina({"info", WriteRecording("street", Street(3))});
  EXPECT_THAT(folder.out, AllOf(HasSubstr("3 files *.bin"), HasSubstr("3 scans over 0.2")));
}

// Of what mapping would take no point, info says why, and no command.
TEST_F(ContainersTest, InfoRecommendsNothingThatMapsNothing) {
  const auto info = [this](const std::string& path) { return Lamina({"info", path}).out; };
  const auto no_command = AllOf(HasSubstr("map it  not as it is"), Not(HasSubstr("lamina run")));
  // LAS at the coordinates of a country.
  std::filesystem::create_directories(Path("las"));
  for (const char* name : {"las/a.las", "las/b.las"}) {
    CloudWriter writer(Path(name));
    writer.Append({{{637012.0, 849028.0, 431.0}, 0.5F, 0.0}});
    writer.Commit();
  }
  EXPECT_THAT(info(Path("las")),
              AllOf(HasSubstr("doubt   none of the first 2 scans can be read; "),
                    HasSubstr("a.las: all points are more than 10 km from the origin"),
                    Not(HasSubstr("points  ")), Not(HasSubstr("sensor  ")), no_command));
  EXPECT_THAT(info(Path("las/a.las")),
              AllOf(HasSubstr("doubt   " + Path("las/a.las")), no_command));
  // The same in a format that says nothing of frames, and a room in millimetres.
  std::vector<ScanPoint> scan(100, {637012.0F, 849028.0F, 431.0F, 0.0F});
  EXPECT_THAT(info(Write("utm.bin", KittiBin(scan))),
              AllOf(HasSubstr("none within preparation.min_range_m=2 to max_range_m=100: a map"),
                    no_command));
  scan.assign(100, {3000.0F, 2000.0F, 431.0F, 0.0F});
  EXPECT_THAT(info(Write("mm.bin", KittiBin(scan))),
              AllOf(HasSubstr("are 3631.2 to 3631.2 m from the origin"), Not(HasSubstr("a map,")),
                    no_command));
  const std::string good = WriteRecording("street", Street(1));
  EXPECT_THAT(info(good), AllOf(HasSubstr("lamina run --scans"), Not(HasSubstr("doubt"))));
}

TEST_F(ContainersTest, ASingleScanIsMapped) {
  WriteRecording("street", Street(2));
  const std::string scan = Path("street/velodyne/000001.bin");
  EXPECT_THAT(Lamina({"info", scan}).out,
              AllOf(HasSubstr("1 file *.bin"), HasSubstr("lamina run --scans " + scan)));
  Run(scan);
  EXPECT_EQ(Summary()["frames"], 1);
  EXPECT_EQ(Lines(Bytes(Path("out/trajectory_tum.txt"))).size(), 1U);
}

}  // namespace
}  // namespace lamina
