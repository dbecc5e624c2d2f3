// Scans and poses in the layout of the ETHZ data set.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "io/recording/scan_source.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;

constexpr const char* kPoseHeader =
    "poseId,timestamp,T00,T01,T02,T03,T10,T11,T12,T13,T20,T21,T22,T23,T30,T31,T32,T33\n";

class EthzTest : public FilesTest {
 protected:
  void WriteTwoScans() const {
    Write("Hokuyo_0.csv", "timestamp,x,y,z,intensities\n12.5,1,2,3,40\n12.6,-4,5.5,6e-1,7\n");
    Write("Hokuyo_1.csv", "timestamp,x,y,z,intensities\n13.5,1,2,3,40\n");
  }
};

TEST_F(EthzTest, ScansAreReadByTheNamesOfTheirColumns) {
  WriteTwoScans();
  const auto scans = OpenScans(folder_.string(), {});
  ASSERT_EQ(scans->size(), 2U);
  const Scan scan = scans->Read(0);
  ASSERT_EQ(scan.points.size(), 2U);
  EXPECT_FLOAT_EQ(scan.points[1].x, -4.0F);
  EXPECT_FLOAT_EQ(scan.points[1].y, 5.5F);
  EXPECT_FLOAT_EQ(scan.points[1].z, 0.6F);
  EXPECT_FLOAT_EQ(scan.points[1].intensity, 7.0F);
  EXPECT_TRUE(scan.time_s.empty());
}

TEST_F(EthzTest, SemicolonsOtherOrderQuotesAndCarriageReturnsAreFine) {
  Write("Hokuyo_0.csv", "\xEF\xBB\xBF\"Z\"; \"Y\" ;X;pointId;\r\n3;2;1;17;\r\n6 ; 5;4;18;\r\n");
  const Scan scan = OpenScans(folder_.string(), {})->Read(0);
  ASSERT_EQ(scan.points.size(), 2U);
  EXPECT_FLOAT_EQ(scan.points[1].x, 4.0F);
  EXPECT_FLOAT_EQ(scan.points[1].y, 5.0F);
  EXPECT_FLOAT_EQ(scan.points[1].z, 6.0F);
  EXPECT_FLOAT_EQ(scan.points[1].intensity, 0.0F);
}

TEST_F(EthzTest, TenComesAfterTwoAndOtherTablesAreNoScans) {
  for (const char* n : {"10", "2", "0"}) {
    Write(std::string("Hokuyo_") + n + ".csv", std::string("x,y,z\n") + n + ",0,0\n");
  }
  Write("overlap_apartment.csv", "1,2\n");
  const auto scans = OpenScans(folder_.string(), {});
  ASSERT_EQ(scans->size(), 3U);
  EXPECT_FLOAT_EQ(scans->Read(1).points[0].x, 2.0F);
  EXPECT_FLOAT_EQ(scans->Read(2).points[0].x, 10.0F);
}

TEST_F(EthzTest, PosesAndTheirStampsAreRead) {
  WriteTwoScans();
  Write("pose_scanner_leica.csv", std::string(kPoseHeader) +
                                      "0,100.5,1,0,0,1.5,0,1,0,2,0,0,1,3,0,0,0,1\n" +
                                      "1,101.25,0,-1,0,4,1,0,0,5,0,0,1,6,0,0,0,1\n");
  EXPECT_EQ(OpenScans(folder_.string(), {})->Stamp(1), 101250000000);
  const Trajectory poses = ReadTrajectory(Path("pose_scanner_leica.csv"));
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[0].stamp_ns, 100500000000);
  EXPECT_LT((poses[1].T_world_lidar.t - Eigen::Vector3d(4, 5, 6)).norm(), 1e-12);
  EXPECT_LT((poses[1].T_world_lidar * Eigen::Vector3d::UnitX() - Eigen::Vector3d(4, 6, 6)).norm(),
            1e-12);
}

TEST_F(EthzTest, StampsThatDoNotIncreaseAreNone) {
  WriteTwoScans();
  Write("pose_scanner_leica.csv", std::string(kPoseHeader) +
                                      "0,1.3e9,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n" +
                                      "1,1.3e9,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n");
  const auto scans = OpenScans(folder_.string(), {});
  EXPECT_EQ(scans->Stamp(0), 0);
  EXPECT_EQ(scans->Stamp(1), 100000000);
  EXPECT_EQ(ReadTrajectory(Path("pose_scanner_leica.csv"))[1].stamp_ns, 1);
}

TEST_F(EthzTest, FaultsAreNamedWithFileAndLine) {
  const auto message = [&](const std::string& text) {
    Write("Hokuyo_0.csv", text);
    return MessageOf<InputError>([&] { OpenScans(folder_.string(), {})->Read(0); });
  };
  EXPECT_THAT(message(""), HasSubstr("Hokuyo_0.csv: is empty"));
  EXPECT_THAT(message("x,y\n1,2\n"), HasSubstr("Hokuyo_0.csv:1: the header names no column z"));
  EXPECT_THAT(message("1.0,2.0,3.0\n"), HasSubstr("the header names no column x"));
  EXPECT_THAT(message("x,y,z\n"), HasSubstr("holds no points"));
  EXPECT_THAT(message("x,y,z\n1,2,3\n1,two,3\n"),
              HasSubstr("Hokuyo_0.csv:3: 'two' is not a number"));
  EXPECT_THAT(message("x,y,z\n1,2\n"), HasSubstr("Hokuyo_0.csv:2: has 2 columns, the header 3"));
}

TEST_F(EthzTest, PosesThatAreNoneAreNamedWithFileAndLine) {
  const auto message = [&](const std::string& text) {
    const std::string path = Write("poses.csv", text);
    return MessageOf<InputError>([&] { ReadTrajectory(path); });
  };
  EXPECT_THAT(message(std::string(kPoseHeader) + "0,1,2,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n"),
              HasSubstr("poses.csv:2: the left 3x3 block must be a rotation"));
  EXPECT_THAT(message(kPoseHeader), HasSubstr("holds no pose"));
  EXPECT_THAT(message("poseId,timestamp\n0,1\n"), HasSubstr("no column t00"));
}

}  // namespace
}  // namespace lamina
