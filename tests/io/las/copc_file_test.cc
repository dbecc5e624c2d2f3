// Clouds as COPC, read back by the offsets of its specification.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "io/las/laz_points.h"
#include "io/las/octree_order.h"
#include "io/map/map_io.h"
#include "io/points/scan_file.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using Key = std::tuple<int, int, int, int>;  // level, x, y, z

struct Node {
  std::uint64_t place = 0;
  std::int32_t bytes = 0, points = 0;
};

template <typename T>
T At(const std::string& bytes, std::size_t at) {
  T value{};
  EXPECT_LE(at + sizeof(T), bytes.size());
  if (at + sizeof(T) <= bytes.size()) std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

class CopcTest : public FilesTest {
 protected:
  static constexpr std::size_t kInfo = 375 + 54;

  std::string WriteCloud(const std::vector<CloudPoint>& points,
                         const std::string& name = "c.copc.laz") const {
    CloudWriter writer(Path(name));
    for (std::size_t at = 0; at < points.size(); at += 10000) {
      const auto begin = points.begin() + static_cast<std::ptrdiff_t>(at);
      const std::size_t some = std::min<std::size_t>(10000, points.size() - at);
      writer.Append(std::vector<CloudPoint>(begin, begin + static_cast<std::ptrdiff_t>(some)));
    }
    EXPECT_EQ(writer.size(), points.size());
    writer.Commit();
    return Bytes(Path(name));
  }

  // Streets and walls of a town of so many metres; points lie on a grid of 0.1 mm.
  static std::vector<CloudPoint> Town(int count, double size_m, const Eigen::Vector3d& origin) {
    std::mt19937 random(2);
    const auto units = [&](double metres) {
      return 1e-4 * static_cast<double>(random() % static_cast<unsigned>(1e4 * metres));
    };
    std::vector<CloudPoint> points;
    for (int i = 0; i < count; ++i) {
      Eigen::Vector3d p(units(size_m), units(size_m), 0.0);
      if (i % 2 == 0) p = {20.0 * std::round(p.x() / 20.0), p.y(), units(8.0)};
      points.push_back({origin + p, static_cast<float>(i % 256), 1.3e9 + 1e-4 * i});
    }
    return points;
  }

  static void ReadPage(const std::string& bytes, std::uint64_t at, std::uint64_t length,
                       std::map<Key, Node>* nodes) {
    EXPECT_EQ(length % 32, 0U);
    for (; length >= 32; at += 32, length -= 32) {
      const Key key{At<std::int32_t>(bytes, at), At<std::int32_t>(bytes, at + 4),
                    At<std::int32_t>(bytes, at + 8), At<std::int32_t>(bytes, at + 12)};
      const Node node{At<std::uint64_t>(bytes, at + 16), At<std::int32_t>(bytes, at + 24),
                      At<std::int32_t>(bytes, at + 28)};
      if (node.points < 0) {
        ReadPage(bytes, node.place, static_cast<std::uint64_t>(node.bytes), nodes);
      } else {
        EXPECT_TRUE(nodes->emplace(key, node).second);
      }
    }
  }
  static std::map<Key, Node> Nodes(const std::string& bytes) {
    std::map<Key, Node> nodes;
    ReadPage(bytes, At<std::uint64_t>(bytes, kInfo + 40), At<std::uint64_t>(bytes, kInfo + 48),
             &nodes);
    return nodes;
  }
};

TEST_F(CopcTest, HeadSaysWhatTheSpecificationWants) {
  const std::string copc = WriteCloud(Town(1000, 100.0, {500, 600, 7}));
  EXPECT_EQ(copc.substr(0, 4), "LASF");
  EXPECT_EQ(copc.substr(377, 4), "copc");
  EXPECT_EQ(At<std::uint16_t>(copc, 393), 1);
  EXPECT_EQ(At<std::uint16_t>(copc, 395), 160);
  EXPECT_EQ(At<std::uint8_t>(copc, 104), 0x86);
  EXPECT_EQ(At<std::uint16_t>(copc, 105), 30);
  EXPECT_EQ(At<std::uint64_t>(copc, 247), 1000U);
  EXPECT_EQ(At<double>(copc, kInfo + 56), 1.3e9);
  EXPECT_NEAR(At<double>(copc, kInfo + 64), 1.3e9 + 0.0999, 1e-6);
  for (std::size_t i = 0; i < 11; ++i) EXPECT_EQ(At<std::uint64_t>(copc, kInfo + 72 + 8 * i), 0U);
  // The cube holds the bounds; the spacing halves the way to a node's cells.
  const double half = At<double>(copc, kInfo + 24);
  EXPECT_EQ(At<double>(copc, kInfo + 32), 2.0 * half / 128);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double centre = At<double>(copc, kInfo + 8 * axis);
    EXPECT_LE(At<double>(copc, 179 + 16 * axis), centre + half);
    EXPECT_GE(At<double>(copc, 187 + 16 * axis), centre - half - 1e-9);
  }
  // The record of the hierarchy ends the file.
  const auto extended = At<std::uint64_t>(copc, 235);
  EXPECT_EQ(At<std::uint32_t>(copc, 243), 1U);
  EXPECT_STREQ(copc.data() + extended + 2, "copc");
  EXPECT_EQ(At<std::uint16_t>(copc, extended + 18), 1000);
  EXPECT_EQ(extended + 60 + At<std::uint64_t>(copc, extended + 20), copc.size());
  EXPECT_EQ(At<std::uint64_t>(copc, kInfo + 40), extended + 60);
}

TEST_F(CopcTest, EveryPointIsInOneNodeWithinItsCube) {
  // Thin all over, and dense in one place.
  std::vector<CloudPoint> points = Town(30'000, 3000.0, {4'321'000, -987'000, 100});
  const std::vector<CloudPoint> dense = Town(90'000, 30.0, {4'321'500, -986'000, 100});
  points.insert(points.end(), dense.begin(), dense.end());
  const std::string copc = WriteCloud(points);
  const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  const std::map<Key, Node> nodes = Nodes(copc);
  const double half = At<double>(copc, kInfo + 24);
  std::multiset<std::string> found;
  int deepest = 0, outside = 0;
  for (const auto& [key, node] : nodes) {
    const auto [level, x, y, z] = key;
    deepest = std::max(deepest, level);
    if (level > 0) {
      EXPECT_EQ(nodes.count({level - 1, x / 2, y / 2, z / 2}), 1U) << "out of reach";
    }
    EXPECT_LE(node.points, 61'000);
    if (node.points == 0) continue;
    const double edge = 2.0 * half / (1 << level);
    const std::array<int, 3> at = {x, y, z};
    UnpackLazChunk(layout, copc.substr(node.place, static_cast<std::size_t>(node.bytes)),
                   static_cast<std::uint64_t>(node.points), "node", [&](std::string_view record) {
                     for (std::size_t axis = 0; axis < 3; ++axis) {
                       std::int32_t units;
                       std::memcpy(&units, record.data() + 4 * axis, 4);
                       const double low =
                           At<double>(copc, kInfo + 8 * axis) - half + edge * at[axis];
                       const double p = At<double>(copc, 155 + 8 * axis) + 1e-4 * units;
                       if (p < low - 1e-6 || p > low + edge + 1e-6) ++outside;
                     }
                     found.emplace(record);
                   });
  }
  EXPECT_EQ(outside, 0);
  EXPECT_GT(deepest, 6) << "no pages of lower levels";
  EXPECT_GT(nodes.size(), 40U);
  EXPECT_GT(nodes.at({0, 0, 0, 0}).points, 3000);
  // The same records as in LAS.
  const std::string las = WriteCloud(points, "c.las");
  std::multiset<std::string> expected;
  const auto begin = At<std::uint32_t>(las, 96);
  for (std::size_t at = begin; at < las.size(); at += 30) expected.insert(las.substr(at, 30));
  EXPECT_TRUE(found == expected);
  EXPECT_LT(2 * copc.size(), las.size());
}

TEST_F(CopcTest, UpperLevelsCoverTheWholeCloud) {
  const std::string copc = WriteCloud(Town(200'000, 100.0, {0, 0, 0}));
  const std::map<Key, Node> nodes = Nodes(copc);
  const Node& root = nodes.at({0, 0, 0, 0});
  std::set<std::pair<int, int>> squares;  // of 5 m
  UnpackLazChunk(LazLayoutOfFormat6(kLazAnyPoints),
                 copc.substr(root.place, static_cast<std::size_t>(root.bytes)),
                 static_cast<std::uint64_t>(root.points), "root", [&](std::string_view record) {
                   std::int32_t p[2];
                   std::memcpy(p, record.data(), sizeof(p));
                   const auto square = [&](int axis) {
                     const double offset =
                         At<double>(copc, 155 + 8 * static_cast<std::size_t>(axis));
                     return static_cast<int>(std::floor((offset + 1e-4 * p[axis]) / 5.0));
                   };
                   squares.emplace(square(0), square(1));
                 });
  EXPECT_GE(squares.size(), 20U * 20U);
}

TEST_F(CopcTest, OrderOfPointsMakesNoDifference) {
  std::vector<CloudPoint> points = Town(30'000, 50.0, {0, 0, 0});
  const std::string one = WriteCloud(points, "a.copc.laz");
  // The first points tell offset and scale of intensities.
  std::shuffle(points.begin() + 10000, points.end(), std::mt19937(1));
  EXPECT_TRUE(WriteCloud(points, "b.copc.laz") == one);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 2)
      << "points are left beside the file";
}

TEST_F(CopcTest, IsReadAsLaz) {
  const std::vector<CloudPoint> points = Town(70'000, 60.0, {0, 0, 0});
  WriteCloud(points);
  const Scan scan = ReadScanFile(Path("c.copc.laz"), {});
  ASSERT_EQ(scan.points.size(), points.size());
  double sum = 0.0, expected = 0.0;
  for (const ScanPoint& p : scan.points) sum += p.x + 2.0 * p.y + 3.0 * p.z;
  for (const CloudPoint& p : points) expected += p.p.x() + 2.0 * p.p.y() + 3.0 * p.p.z();
  EXPECT_NEAR(sum, expected, 1e-5 * static_cast<double>(points.size()));
}

TEST_F(CopcTest, FewPointsOrNoneAreAFile) {
  EXPECT_EQ(Nodes(WriteCloud({})).size(), 1U);
  const std::vector<CloudPoint> same(100, {{1, 2, 3}, 5.0F, 10.0});
  const std::string copc = WriteCloud(same);
  EXPECT_EQ(Nodes(copc).at({0, 0, 0, 0}).points, 100);
  const std::string far = WriteCloud({{{0, 0, 0}, 0, 0}, {{200e3, 0, 0}, 0, 0}});
  EXPECT_EQ(Nodes(far).at({0, 0, 0, 0}).points, 2);
  EXPECT_THROW(WriteCloud({{{0, 0, 0}, 0, 0}, {{300e3, 0, 0}, 0, 0}}), OutputError);
  EXPECT_THROW(CloudWriter(Path("no/such.copc.laz")), OutputError);
}

// More records than are sorted at once.
TEST_F(CopcTest, PointsBeyondMemoryAreInOrder) {
  constexpr std::size_t kRecords = 1'100'000, kBytes = 12;
  SpoolFile spool(Path("sorted"));
  std::mt19937 random(4);
  std::string records;
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < kRecords; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto units = static_cast<std::int32_t>(random() % 100'000) - 50'000;
      sum += static_cast<std::uint64_t>(units + 50'000);
      records += Pack(units);
    }
  }
  spool.Append(records);
  const std::array<std::int32_t, 3> least = {-50'000, -50'000, -50'000};
  std::size_t visited = 0;
  std::uint64_t visited_sum = 0;
  int same_cell = 0;
  OctreePlace before{};
  VisitInOctreeOrder(&spool, kBytes, least, [&](std::string_view record) {
    const OctreePlace place = OctreePlaceOf(record.data(), least);
    ++visited;
    visited_sum += std::uint64_t{place[0]} + place[1] + place[2];
    if (DifferingBits(place, before) <= 14) ++same_cell;
    before = place;
  });
  EXPECT_EQ(visited, kRecords);
  EXPECT_EQ(visited_sum, sum);
  // Cells of 2^14 units are 7^3; in order they are entered once each.
  EXPECT_EQ(kRecords - static_cast<std::size_t>(same_cell), 7U * 7U * 7U - 1U);
}

}  // namespace
}  // namespace lamina
