#include "io/map/map_io.h"

#include <cmath>
#include <limits>

#include "io/points/scan_file.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

Surfel MakeSurfel(double thickness_m) {
  Surfel s;
  s.centre = Eigen::Vector3d(1.5, -2.5, 3.5);
  s.normal = Eigen::Vector3f(0, 0, 1);
  s.eigenvalues = Eigen::Vector3f(0.25F, 0.125F, static_cast<float>(thickness_m * thickness_m));
  s.count = 70000;
  return s;
}

std::string Body(const std::string& bytes, const std::string& end_of_header) {
  return bytes.substr(bytes.find(end_of_header) + end_of_header.size());
}

class MapTest : public FilesTest {
 protected:
  std::string RecordPly(const Surfel& surfel) const {
    WriteSurfels(Path("m.ply"), {surfel});
    return Body(Bytes(Path("m.ply")), "end_header\n");
  }
};

TEST_F(MapTest, SurfelPlyByteByByte) {
  const Surfel s = MakeSurfel(0.025);
  EXPECT_EQ(RecordPly(s), Pack(1.5F, -2.5F, 3.5F, 0.0F, 0.0F, 1.0F, 0.25F, 0.125F, s.eigenvalues[2],
                               std::sqrt(s.eigenvalues[2]), 70000U, '\0', '\xff', '\0'));
  EXPECT_THAT(Bytes(Path("m.ply")),
              AllOf(testing::StartsWith("ply\nformat binary_little_endian 1.0\n"),
                    HasSubstr("element vertex 1\n"), HasSubstr("property float thickness_m\n"),
                    HasSubstr("property uint count\nproperty uchar red\n")));
}

TEST_F(MapTest, ThicknessRampFromBlueOverGreenToRed) {
  const auto colour = [&](double thickness_m) {
    const std::string record = RecordPly(MakeSurfel(thickness_m));
    return record.substr(record.size() - 3);
  };
  EXPECT_EQ(colour(0.0), Pack('\0', '\0', '\xff'));
  EXPECT_EQ(colour(0.01), Pack('\0', '\x66', '\x99'));
  EXPECT_EQ(colour(0.04), Pack('\x99', '\x66', '\0'));
  EXPECT_EQ(colour(0.05), Pack('\xff', '\0', '\0'));
  EXPECT_EQ(colour(10.0), Pack('\xff', '\0', '\0'));
}

TEST_F(MapTest, EigenvalueRoundedBelowZeroIsNoThickness) {
  Surfel s = MakeSurfel(0.0);
  s.eigenvalues[2] = -1e-12F;
  EXPECT_EQ(RecordPly(s).substr(36, 4), Pack(0.0F));
}

TEST_F(MapTest, SurfelPcdByteByByte) {
  const Surfel s = MakeSurfel(0.0);
  WriteSurfels(Path("m.pcd"), {s, s});
  const std::string bytes = Bytes(Path("m.pcd"));
  const std::string record =
      Pack(1.5F, -2.5F, 3.5F, 0.0F, 0.0F, 1.0F, 0.25F, 0.125F, 0.0F, 0.0F, 70000U, 0x000000ffU);
  EXPECT_EQ(Body(bytes, "DATA binary\n"), record + record);
  EXPECT_THAT(bytes, AllOf(HasSubstr("FIELDS x y z normal_x normal_y normal_z l1 l2 l3 "
                                     "thickness_m count rgb\n"),
                           HasSubstr("SIZE 4 4 4 4 4 4 4 4 4 4 4 4\n"),
                           HasSubstr("TYPE F F F F F F F F F F U U\n"), HasSubstr("WIDTH 2\n"),
                           HasSubstr("POINTS 2\n")));
}

TEST_F(MapTest, SurfelFilesAreReadBackAsClouds) {
  const SurfelMap surfels = {MakeSurfel(0.0), MakeSurfel(0.03)};
  WriteSurfels(Path("m.ply"), surfels);
  WriteSurfels(Path("m.pcd"), surfels);
  for (const char* name : {"m.ply", "m.pcd"}) {
    const Scan scan = ReadScanFile(Path(name), {});
    ASSERT_EQ(scan.points.size(), 2U) << name;
    EXPECT_EQ(scan.points[1].y, -2.5F) << name;
  }
}

TEST_F(MapTest, SameSurfelsSameBytes) {
  const SurfelMap surfels = {MakeSurfel(0.01), MakeSurfel(0.03)};
  WriteSurfels(Path("a.ply"), surfels);
  WriteSurfels(Path("b.ply"), surfels);
  EXPECT_EQ(Bytes(Path("a.ply")), Bytes(Path("b.ply")));
}

TEST_F(MapTest, EmptyMapIsAFile) {
  WriteSurfels(Path("m.ply"), {});
  EXPECT_THAT(Bytes(Path("m.ply")), testing::EndsWith("end_header\n"));
}

TEST_F(MapTest, CloudRoundTripInPieces) {
  for (const char* name : {"c.ply", "c.pcd"}) {
    CloudWriter writer(Path(name));
    std::size_t written = 0;
    for (std::size_t piece = 0; piece < 20; ++piece) {
      std::vector<ScanPoint> points(piece * 10);
      for (ScanPoint& p : points) p = {static_cast<float>(written++), 2, 3, 0.5F};
      writer.Append(points);
    }
    EXPECT_EQ(writer.size(), 1900U);
    EXPECT_FALSE(fs::exists(Path(name)));
    writer.Commit();
    const Scan scan = ReadScanFile(Path(name), {});
    ASSERT_EQ(scan.points.size(), 1900U) << name;
    EXPECT_EQ(scan.points[1899].x, 1899.0F);
    EXPECT_EQ(scan.points[1899].intensity, 0.5F);
  }
}

// As files that are read.
TEST_F(MapTest, EndingsCountInAnyCase) {
  for (const char* name : {"c.PLY", "c.Pcd", "c.LAS", "c.LAZ", "c.COPC.LAZ"}) {
    CloudWriter writer(Path(name));
    writer.Append(std::vector<ScanPoint>{{1, 2, 3, 0.5F}, {4, 5, 6, 0.5F}});
    writer.Commit();
    EXPECT_EQ(ReadScanFile(Path(name), {}).points.size(), 2U) << name;
  }
  EXPECT_THAT(Bytes(Path("c.COPC.LAZ")), testing::HasSubstr("copc"));
  EXPECT_THAT(Bytes(Path("c.LAZ")), testing::Not(testing::HasSubstr("copc")));
}

TEST_F(MapTest, CloudWithoutCommitLeavesNothing) {
  { CloudWriter(Path("c.ply")).Append(std::vector<ScanPoint>(1)); }
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(MapTest, OutputsThatCannotBeAreNamed) {
  EXPECT_THAT(MessageOf<OptionError>([&] { CloudWriter writer(Path("c.xyz")); }),
              AllOf(HasSubstr("c.xyz"), HasSubstr(".ply, .pcd, .las, .laz or .copc.laz")));
  EXPECT_THROW(CloudWriter(Path("none/c.ply")), OutputError);
  EXPECT_THROW(WriteSurfels(Path("none/m.ply"), {}), OutputError);
  EXPECT_THROW(WriteSurfels(Path("none/m.pcd"), {}), OutputError);
}

}  // namespace
}  // namespace lamina
