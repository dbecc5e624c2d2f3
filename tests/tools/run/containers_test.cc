// The same scans give the same trajectory, whatever they came in.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/container_files.h"
#include "tests/support/run_helpers.h"
#include "tests/support/swept_messages.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

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

}  // namespace
}  // namespace lamina
