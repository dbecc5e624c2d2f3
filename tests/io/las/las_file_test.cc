// LAS 1.4, read back by the offsets of its specification.
#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "io/map/map_io.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;

class LasTest : public FilesTest {
 protected:
  std::string WriteCloud(const std::string& name, const std::vector<CloudPoint>& points) const {
    CloudWriter writer(Path(name));
    writer.Append(points);
    EXPECT_EQ(writer.size(), points.size());
    writer.Commit();
    return Bytes(Path(name));
  }

  template <typename T>
  static T At(const std::string& bytes, std::size_t offset) {
    T value;
    EXPECT_LE(offset + sizeof(T), bytes.size());
    std::memcpy(&value, bytes.data() + offset, sizeof(T));
    return value;
  }

  static std::size_t PointsAt(const std::string& bytes) { return At<std::uint32_t>(bytes, 96); }
  static Eigen::Vector3d PointOf(const std::string& bytes, std::size_t i) {
    Eigen::Vector3d p;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto units = At<std::int32_t>(bytes, PointsAt(bytes) + 30 * i + 4 * axis);
      p(static_cast<Eigen::Index>(axis)) =
          At<double>(bytes, 155 + 8 * axis) + At<double>(bytes, 131 + 8 * axis) * units;
    }
    return p;
  }
};

TEST_F(LasTest, HeaderSaysWhatTheSpecificationWants) {
  const std::string las = WriteCloud("c.las", {{{1, 2, 3}, 0.5F, 10.0}, {{4, -5, 6}, 1.0F, 11.0}});
  EXPECT_EQ(las.substr(0, 4), "LASF");
  EXPECT_EQ(At<std::uint16_t>(las, 6), 16);  // the coordinate system is well-known text
  EXPECT_EQ(At<std::uint8_t>(las, 24), 1);
  EXPECT_EQ(At<std::uint8_t>(las, 25), 4);
  EXPECT_EQ(At<std::uint16_t>(las, 94), 375);
  EXPECT_EQ(At<std::uint32_t>(las, 100), 1U);
  EXPECT_EQ(At<std::uint8_t>(las, 104), 6);
  EXPECT_EQ(At<std::uint16_t>(las, 105), 30);
  EXPECT_EQ(At<std::uint32_t>(las, 107), 0U);  // the old count, of no use with this format
  EXPECT_EQ(At<std::uint64_t>(las, 247), 2U);
  EXPECT_EQ(At<std::uint64_t>(las, 255), 2U);
  EXPECT_EQ(las.size(), PointsAt(las) + 2 * 30);
  // Largest and least of x, y, z.
  const double bounds[] = {4, 1, 2, -5, 6, 3};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(At<double>(las, 179 + 8 * i), bounds[i], 1e-9);
  // The record of the coordinate system ends where the points begin.
  EXPECT_STREQ(las.data() + 377, "LASF_Projection");
  EXPECT_EQ(At<std::uint16_t>(las, 393), 2112);
  EXPECT_EQ(375U + 54U + At<std::uint16_t>(las, 395), PointsAt(las));
  EXPECT_THAT(las.substr(375 + 54, 9), "LOCAL_CS[");
}

TEST_F(LasTest, KeepsATenthOfAMillimetreAtLargeCoordinates) {
  std::vector<CloudPoint> points;
  for (int i = 0; i < 100; ++i) {
    points.push_back({{4'321'000.0 + 1e-4 * i, -987'654.3 + 1000.0 * i, 0.05 * i}, 0.1F, 1e-3 * i});
  }
  const std::string las = WriteCloud("c.las", points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LT((PointOf(las, i) - points[i].p).cwiseAbs().maxCoeff(), 0.51e-4) << i;
    EXPECT_EQ(At<double>(las, PointsAt(las) + 30 * i + 22), points[i].stamp_s) << i;
    EXPECT_EQ(At<std::uint8_t>(las, PointsAt(las) + 30 * i + 14), 0x11) << i;
  }
}

TEST_F(LasTest, IntensitiesOfEveryScaleFillSixteenBits) {
  const auto intensity = [&](float most, float value) {
    const std::string las = WriteCloud("c.las", {{{0, 0, 0}, most, 0}, {{1, 0, 0}, value, 0}});
    return At<std::uint16_t>(las, PointsAt(las) + 30 + 12);
  };
  EXPECT_EQ(intensity(1.0F, 0.5F), 32768);
  EXPECT_EQ(intensity(255.0F, 100.0F), 25700);
  EXPECT_EQ(intensity(4000.0F, 1234.0F), 1234);
  EXPECT_EQ(intensity(1.0F, -3.0F), 0);
  EXPECT_EQ(intensity(1.0F, std::numeric_limits<float>::quiet_NaN()), 0);
}

TEST_F(LasTest, PiecesAndOnePieceGiveTheSameBytes) {
  const std::vector<CloudPoint> points = {{{1, 2, 3}, 0.5F, 1}, {{4, 5, 6}, 0.7F, 2}};
  const std::string whole = WriteCloud("a.las", points);
  CloudWriter writer(Path("b.las"));
  for (const CloudPoint& point : points) writer.Append(std::vector<CloudPoint>{point});
  writer.Append(std::vector<CloudPoint>());
  writer.Commit();
  EXPECT_EQ(Bytes(Path("b.las")), whole);
}

TEST_F(LasTest, AnEmptyCloudIsAFile) {
  const std::string las = WriteCloud("c.las", {});
  EXPECT_EQ(At<std::uint64_t>(las, 247), 0U);
  EXPECT_EQ(las.size(), PointsAt(las));
}

TEST_F(LasTest, PointsThatDoNotFitAreRefusedAndLeaveNothing) {
  for (const double far : {300e3, std::numeric_limits<double>::infinity(), std::nan("")}) {
    EXPECT_THAT(MessageOf<OutputError>([&] {
                  WriteCloud("c.las", {{{0, 0, 0}, 0, 0}, {{0, far, 0}, 0, 0}});
                }),
                HasSubstr("c.las"));
    EXPECT_TRUE(std::filesystem::is_empty(folder_));
  }
}

}  // namespace
}  // namespace lamina
