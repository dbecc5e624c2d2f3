#include <random>

#include "io/map/trajectory_io.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Trajectory RandomTrajectory(int poses) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Trajectory trajectory;
  for (int i = 0; i < poses; ++i) {
    const Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
    const Eigen::Vector3d t(normal(random), 1e6 * normal(random), 1e-6 * normal(random));
    trajectory.push_back({1317384506400123457 + i * 100000001LL, SE3(q, t)});
  }
  return trajectory;
}

void ExpectSamePoses(const Trajectory& a, const Trajectory& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_LT(RotationAngle(a[i].T_world_lidar, b[i].T_world_lidar), 1e-9);
    EXPECT_LT((a[i].T_world_lidar.t - b[i].T_world_lidar.t).norm(), 1e-9);
  }
}

class TrajectoryTest : public FilesTest {
 protected:
  std::string ReadError(const std::string& text) const {
    const std::string path = Write("poses.txt", text);
    return MessageOf<InputError>([&] { ReadTrajectory(path); });
  }
};

constexpr char kIdentity[] = "1 0 0 0 0 1 0 0 0 0 1 0\n";

TEST_F(TrajectoryTest, KittiRoundTrip) {
  const Trajectory written = RandomTrajectory(100);
  WriteKittiTrajectory(Path("poses.txt"), written);
  std::vector<StampNs> stamps;
  for (const StampedPose& pose : written) stamps.push_back(pose.stamp_ns);
  const Trajectory read = ReadTrajectory(Path("poses.txt"), stamps);
  ExpectSamePoses(written, read);
  EXPECT_EQ(read[99].stamp_ns, written[99].stamp_ns);
}

TEST_F(TrajectoryTest, KittiPosesWithoutStampsAreCounted) {
  const Trajectory read =
      ReadTrajectory(Write("p.txt", std::string("\n") + kIdentity + "\n" + kIdentity));
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].stamp_ns, 0);
  EXPECT_EQ(read[1].stamp_ns, 1);
}

TEST_F(TrajectoryTest, TumRoundTripKeepsStampsToTheNanosecond) {
  Trajectory written = RandomTrajectory(100);
  written[0].stamp_ns = -1;
  written[1].stamp_ns = -1500000000;
  written[2].stamp_ns = 0;
  written[3].stamp_ns = 9223372036854775807;
  WriteTumTrajectory(Path("poses.tum"), written);
  EXPECT_THAT(Bytes(Path("poses.tum")), testing::StartsWith("-0.000000001 "));
  const Trajectory read = ReadTrajectory(Path("poses.tum"));
  ExpectSamePoses(written, read);
  for (std::size_t i = 0; i < read.size(); ++i) EXPECT_EQ(read[i].stamp_ns, written[i].stamp_ns);
}

TEST_F(TrajectoryTest, CommentsBlankLinesAndCrlfAreTolerated) {
  const Trajectory read = ReadTrajectory(
      Write("p.tum", "# stamp tx ...\r\n\r\n1.5 1 2 3 0 0 0 1\r\n  \t\r\n2 +1 2e0 3 0 0 1 0"));
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].stamp_ns, 1500000000);
  EXPECT_EQ(read[1].T_world_lidar.t, Eigen::Vector3d(1, 2, 3));
}

TEST_F(TrajectoryTest, RoundedRotationIsRepaired) {
  const Trajectory read = ReadTrajectory(Write("p.txt", "0.8 -0.6004 0 0 0.6 0.8 0 0 0 0 1 0"));
  const Eigen::Matrix3d R = read[0].T_world_lidar.R();
  EXPECT_LT((R.transpose() * R - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  EXPECT_NEAR(R(0, 0), 0.8, 1e-3);
}

TEST_F(TrajectoryTest, NanPoseLineIsNamed) {
  EXPECT_THAT(ReadError(std::string(kIdentity) + "1 0 0 nan 0 1 0 0 0 0 1 0\n"),
              AllOf(HasSubstr("poses.txt:2:"), HasSubstr("finite")));
  EXPECT_THAT(ReadError("1 0 0 inf 0 0 0 1\n"), HasSubstr("finite"));
}

TEST_F(TrajectoryTest, WrongCountOfNumbersIsNamed) {
  EXPECT_THAT(ReadError("1 2 3\n"), AllOf(HasSubstr("poses.txt:1:"), HasSubstr("found 3")));
  EXPECT_THAT(ReadError(std::string(kIdentity) + "\n1 0 0 0 0 1 0 0 0 0 1\n"),
              AllOf(HasSubstr("poses.txt:3:"), HasSubstr("found 11")));
  EXPECT_THAT(ReadError(std::string("1 0 0 0 0 0 0 1\n") + kIdentity),
              AllOf(HasSubstr("poses.txt:2:"), HasSubstr("found 12")));
}

TEST_F(TrajectoryTest, WordsThatAreNoNumbersAreNamed) {
  EXPECT_THAT(ReadError("1 0 0 0 0 1 0 0 0 zero 1 0\n"),
              AllOf(HasSubstr("poses.txt:1:"), HasSubstr("'zero'")));
  EXPECT_THAT(ReadError("1 0 0 0 0 1 0 0 0 1.5x 1 0\n"), HasSubstr("'1.5x'"));
}

TEST_F(TrajectoryTest, NonOrthonormalRotationIsNamed) {
  EXPECT_THAT(ReadError(std::string(kIdentity) + "1 0.01 0 0 0 1 0 0 0 0 1 0\n"),
              AllOf(HasSubstr("poses.txt:2:"), HasSubstr("rotation")));
  EXPECT_THAT(ReadError("1 0 0 0 0 1 0 0 0 0 -1 0\n"), HasSubstr("determinant"));
  EXPECT_THAT(ReadError("0 0 0 0 0 0 0 0 0 0 0 0\n"), HasSubstr("rotation"));
  EXPECT_THAT(ReadError("1 0 0 0 0 0 0 0\n"), HasSubstr("norm 0"));
}

TEST_F(TrajectoryTest, StampThatDoesNotFitIsNamed) {
  EXPECT_THAT(ReadError("1e30 0 0 0 0 0 0 1\n"), HasSubstr("'1e30'"));
}

TEST_F(TrajectoryTest, MorePosesThanStampsIsNamed) {
  const std::string path = Write("p.txt", std::string(kIdentity) + kIdentity);
  EXPECT_THAT(MessageOf<InputError>([&] { ReadTrajectory(path, {5}); }),
              AllOf(HasSubstr("p.txt:2:"), HasSubstr("1 stamps")));
}

TEST_F(TrajectoryTest, MissingOrEmptyFileIsNamed) {
  EXPECT_THAT(MessageOf<InputError>([&] { ReadTrajectory(Path("none.txt")); }),
              AllOf(HasSubstr("none.txt"), HasSubstr("No such file")));
  EXPECT_THAT(MessageOf<InputError>([&] { ReadTrajectory(folder_.string()); }),
              HasSubstr("not a regular file"));
  EXPECT_THAT(ReadError(""), HasSubstr("holds no pose"));
  EXPECT_THAT(ReadError("# nothing\n"), HasSubstr("holds no pose"));
}

TEST_F(TrajectoryTest, WritersNameTheFileThatTheyCannotWrite) {
  EXPECT_THROW(WriteKittiTrajectory(Path("none/p.txt"), {}), OutputError);
  EXPECT_THROW(WriteTumTrajectory(Path("none/p.txt"), {}), OutputError);
}

TEST_F(TrajectoryTest, CameraToLidarConjugates) {
  const Trajectory random = RandomTrajectory(3);
  const SE3& T_camera_lidar = random[0].T_world_lidar;
  const Trajectory lidars = CameraToLidar({random[1]}, T_camera_lidar);
  // A point fixed to the sensor moves the same, whichever frame it is described in.
  const Eigen::Vector3d p(1, 2, 3);
  const Eigen::Vector3d moved = T_camera_lidar * (lidars[0].T_world_lidar * p);
  EXPECT_LT((moved - random[1].T_world_lidar * (T_camera_lidar * p)).norm(), 1e-8);
  EXPECT_EQ(lidars[0].stamp_ns, random[1].stamp_ns);
}

}  // namespace
}  // namespace lamina
