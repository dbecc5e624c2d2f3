// Point files: .bin, .txt, .pcd and .ply, sound and damaged.
#include <cmath>
#include <limits>
#include <vector>

#include "io/points/scan_file.h"
#include "io/recording/scan_source.h"
#include "tests/io/points/scan_file_fixture.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::FloatNear;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;

TEST_F(ScanFileTest, BinIsReadAsItStands) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Scan scan = Read("a.bin", KittiBin({{1, 2, 3, 0.5F}, {nan, 5, 6, 0}}));
  ASSERT_EQ(scan.points.size(), 2U);
  ExpectPoint(scan.points[0], 1, 2, 3, 0.5F);
  EXPECT_TRUE(std::isnan(scan.points[1].x));
  EXPECT_THAT(scan.time_s, IsEmpty());
  EXPECT_EQ(scan.stamp_ns, 0);
}

TEST_F(ScanFileTest, EndingsInAnyCase) {
  const std::string bin = KittiBin({{1, 2, 3, 0.5F}});
  const std::string pcd = XyzHeader("1", "ascii") + "1 2 3\n";
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n1 2 3\n";
  const std::pair<const char*, std::string> files[] = {{"a.BIN", bin},
                                                       {"a.Pcd", pcd},
                                                       {"a.PLY", ply},
                                                       {"a.CSV", "x,y,z\n1,2,3\n"},
                                                       {"a.TXT", "1 2 3 0\n"}};
  for (const auto& [name, bytes] : files) {
    const Scan scan = Read(name, bytes);
    ASSERT_EQ(scan.points.size(), 1U) << name;
    EXPECT_EQ(scan.points[0].y, 2.0F) << name;
    EXPECT_TRUE(IsScanFile(Path(name))) << name;
    EXPECT_FALSE(IsScanFile(Path(std::string(".") + name))) << name;
  }
  EXPECT_EQ(KindOfName("1.LAZ"), ScanName::kPoints);
  EXPECT_EQ(KindOfName("1.Las"), ScanName::kPoints);
  EXPECT_EQ(KindOfName("1.TXT"), ScanName::kText);
  for (const char* none : {"", ".BIN", ".1.bin", "1.bin.part", "1.csv", "bin", "1.", "1.bi"}) {
    EXPECT_EQ(KindOfName(none), ScanName::kNone) << none;
  }
  EXPECT_EQ(ScanEndings(), ".bin, .pcd, .ply, .las, .laz, .csv or .txt");
  EXPECT_EQ(FolderPatterns(), "*.bin, *.pcd, *.ply, *.las, *.laz");
}

// As nuScenes has them. A length that is one of both is no proof.
TEST_F(ScanFileTest, BinsMayHaveTheRingAsAFifthNumber) {
  std::string rings, plain;
  for (int i = 0; i < 80; ++i) {
    const float x = 0.5F + static_cast<float>(i), ring = static_cast<float>(i % 32);
    rings += Pack(x, 2.0F, 3.0F, 7.0F, ring);
    plain += Pack(x, 2.0F, 3.0F, 0.25F);
  }
  for (const std::size_t points : {80, 79}) {
    const Scan scan = Read("a.pcd.bin", rings.substr(0, 20 * points));
    ASSERT_EQ(scan.points.size(), points);
    ExpectPoint(scan.points[70], 70.5F, 2, 3, 7);
  }
  const Scan scan = Read("b.bin", plain);
  ASSERT_EQ(scan.points.size(), 80U);
  ExpectPoint(scan.points[70], 70.5F, 2, 3, 0.25F);
  // Pulses without a return.
  EXPECT_EQ(Read("c.bin", std::string(80, '\0')).points.size(), 5U);
  EXPECT_THAT(ReadError("d.bin", plain.substr(0, 100)),
              HasSubstr("none with the number of its ring"));
}

TEST_F(ScanFileTest, BinsOfOtherPointsAreRefusedWhateverTheirLength) {
  // A ring of a sensor, then the next: points lie beside one another.
  const auto bin = [](const std::vector<float>& more) {
    std::string bytes;
    for (int i = 0; i < 400; ++i) {
      const float azimuth = 0.0628F * static_cast<float>(i),
                  range = 10.0F + 0.1F * static_cast<float>(i / 100);
      bytes += Pack(range * std::cos(azimuth), range * std::sin(azimuth), 0.5F, 0.3F);
      for (const float number : more) bytes += Pack(number + 1e-4F * static_cast<float>(i));
    }
    return bytes;
  };
  EXPECT_EQ(Read("four.bin", bin({})).points.size(), 400U);
  EXPECT_THAT(ReadError("time.bin", bin({0.0F})), HasSubstr("of 5 numbers"));
  EXPECT_THAT(ReadError("six.bin", bin({0.0F, 7.5F})), HasSubstr("of 6 numbers"));
}

TEST_F(ScanFileTest, BinLengthNotMultipleOf16) {
  EXPECT_THAT(ReadError("a.bin", std::string(33, 'x')),
              AllOf(HasSubstr("a.bin"), HasSubstr("33 bytes"), HasSubstr("multiple of 16")));
}

TEST_F(ScanFileTest, EmptyFilesOfEveryKind) {
  EXPECT_THAT(ReadError("a.bin", ""), HasSubstr("empty"));
  EXPECT_THAT(ReadError("a.txt", "\n"), HasSubstr("empty"));
  EXPECT_THAT(ReadError("a.pcd", XyzHeader("0", "binary")), HasSubstr("empty"));
  EXPECT_THAT(ReadError("a.ply",
                        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n"
                        "property float y\nproperty float z\nend_header\n"),
              HasSubstr("empty"));
  EXPECT_THAT(ReadError("b.pcd", ""), HasSubstr("no PCD file"));
  EXPECT_THAT(ReadError("b.ply", ""), HasSubstr("no PLY file"));
}

TEST_F(ScanFileTest, MissingFileFolderAndUnknownEnding) {
  EXPECT_THAT(
      MessageOf<InputError>([&] { ReadScanFile(Path("none.bin"), options_.point_time_unit); }),
      AllOf(HasSubstr("none.bin"), HasSubstr("No such file")));
  std::filesystem::create_directory(Path("dir.pcd"));
  EXPECT_THAT(
      MessageOf<InputError>([&] { ReadScanFile(Path("dir.pcd"), options_.point_time_unit); }),
      HasSubstr("not a regular file"));
  EXPECT_THAT(ReadError("a.e57", "x"), HasSubstr("ends in"));
}

TEST_F(ScanFileTest, KittiText) {
  const Scan scan = Read("a.txt", "1 2 3 0.5\r\n-4.5 5e1 6 0\r\n");
  ASSERT_EQ(scan.points.size(), 2U);
  ExpectPoint(scan.points[1], -4.5F, 50, 6, 0);
  EXPECT_THAT(ReadError("b.txt", "1 2 3 0\n1 2 3\n"),
              AllOf(HasSubstr("b.txt:2:"), HasSubstr("found 3")));
  EXPECT_THAT(ReadError("c.txt", "1 2 ? 0\n"), AllOf(HasSubstr("c.txt:1:"), HasSubstr("'?'")));
}

TEST_F(ScanFileTest, ABinThatIsFarTooLargeIsRefusedBeforeItIsRead) {
  const std::string path = Write("a.bin", "");
  std::filesystem::resize_file(path, std::uintmax_t{1} << 33);  // without its bytes
  EXPECT_THAT(MessageOf<InputError>([&] { ReadScanFile(path, PointTimeUnit::kAuto); }),
              HasSubstr("more than 2 GB"));
}

std::string BigEndianFloat(float value) {
  const std::string bytes = Pack(value);
  return {bytes.rbegin(), bytes.rend()};
}

TEST_F(ScanFileTest, PlyAscii) {
  const Scan scan = Read("a.ply", PlyHeader("ascii", "2", "property float scalar_Intensity\n") +
                                      "1 2 3 0.5\n4 nan 6 0.25\n");
  ASSERT_EQ(scan.points.size(), 2U);
  ExpectPoint(scan.points[0], 1, 2, 3, 0.5F);
  EXPECT_TRUE(std::isnan(scan.points[1].y));
}

TEST_F(ScanFileTest, PlyBinaryWithColoursAndTime) {
  const std::string header = PlyHeader("binary_little_endian", "2",
                                       "property uchar red\nproperty uchar green\n"
                                       "property uchar blue\nproperty double time\n");
  const auto point = [](float x, double time) { return Pack(x, 2.0F, 3.0F, 'r', 'g', 'b', time); };
  const Scan scan = Read("a.ply", header + point(1, 1700000000.0) + point(4, 1700000000.125));
  ExpectPoint(scan.points[1], 4, 2, 3, 0);
  EXPECT_EQ(scan.stamp_ns, 1700000000000000000);
  EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-7F), {0.0F, 0.125F}));
}

TEST_F(ScanFileTest, PlyBigEndianAndOtherElements) {
  const std::string header =
      Replaced(PlyHeader("binary_big_endian", "1"), "end_header",
               "element face 1\nproperty list uchar int vertex_indices\nend_header");
  const Scan scan = Read("a.ply", header + BigEndianFloat(1) + BigEndianFloat(-2.5F) +
                                      BigEndianFloat(3) + Pack('\x1', '\0', '\0', '\0', '\0'));
  ASSERT_EQ(scan.points.size(), 1U);
  ExpectPoint(scan.points[0], 1, -2.5F, 3, 0);
}

TEST_F(ScanFileTest, PlyTruncatedOrWithAbsurdCount) {
  const std::string p = Pack(1.0F, 2.0F, 3.0F);
  for (const char* count : {"3", "4294967295", "99999999999999999999", "-1"}) {
    EXPECT_THAT(ReadError("a.ply", PlyHeader("binary_little_endian", count) + p + p),
                HasSubstr("a.ply:"))
        << count;
    EXPECT_THAT(ReadError("b.ply", PlyHeader("ascii", count) + "1 2 3\n4 5 6\n"),
                HasSubstr("b.ply:"))
        << count;
  }
}

TEST_F(ScanFileTest, PlyColoursListsAndRangeGridsAreNoObstacle) {
  const std::string colours = "property char red\nproperty uchar green\nproperty uchar alpha\n";
  ExpectPoint(Read("a.ply", PlyHeader("ascii", "1", colours) + "1 2 3 -40 50 60\n").points[0], 1, 2,
              3, 0);
  // Other elements before the vertices, with lists of several lengths.
  for (const char* format : {"binary_little_endian", "binary_big_endian"}) {
    const bool big = std::string(format) == "binary_big_endian";
    std::string header = PlyHeader(format, "1");
    header = Replaced(header, "element vertex",
                      "obj_info num_cols 3\nelement range_grid 2\nproperty list uchar ushort "
                      "indices\nproperty uchar flag\nelement vertex");
    std::string data =
        Pack(std::uint8_t{2}, std::uint32_t{7}, std::uint8_t{1}, std::uint8_t{0}, std::uint8_t{1});
    for (float value : {1.0F, 2.0F, 3.0F}) {
      data += big ? BigEndianFloat(value) : Pack(value);
    }
    ExpectPoint(Read("b.ply", header + data).points[0], 1, 2, 3, 0);
    EXPECT_THAT(ReadError("c.ply", header + data.substr(0, data.size() - 1)), HasSubstr("fewer"));
    data[0] = '\xff';
    EXPECT_THAT(ReadError("d.ply", header + data), HasSubstr("within the element 'range_grid'"));
  }
}

TEST_F(ScanFileTest, PlyHeaderLinesThatBreakTheRulesAreNamed) {
  const std::string good = PlyHeader("ascii", "1") + "1 2 3\n";
  const auto error = [&](const std::string& from, const std::string& to) {
    return ReadError("a.ply", Replaced(good, from, to));
  };
  EXPECT_THAT(error("float z", "quad z"), AllOf(HasSubstr("a.ply:7:"), HasSubstr("no type")));
  EXPECT_THAT(error("format ascii", "format latin"), HasSubstr("format must be"));
  EXPECT_THAT(error("element vertex 1", "element vertex"), HasSubstr("a.ply:4:"));
  EXPECT_THAT(error("element vertex 1\n", ""), HasSubstr("after an element"));
  EXPECT_THAT(error("vertex", "corner"), HasSubstr("no element 'vertex'"));
  EXPECT_THAT(error("comment", "remark"), HasSubstr("no line of a PLY header"));
  EXPECT_THAT(error("float z", "list uchar float z"), HasSubstr("lists"));
  EXPECT_THAT(error("float z", "float w"), HasSubstr("no field 'z'"));
  EXPECT_THAT(error("end_header", "end"), HasSubstr("a.ply"));
  EXPECT_THAT(error("1 2 3", "1 2 c"), AllOf(HasSubstr("a.ply:9:"), HasSubstr("'c'")));
  EXPECT_THAT(error("1 2 3", "10 20"), HasSubstr("found 2"));
}

// Whatever single byte is damaged, or wherever the file ends, the answer is a scan or InputError.
TEST_F(ScanFileTest, DamagedFilesNeverCrash) {
  const std::string data = Pack(1.0F, 4.0F, 2.0F, 5.0F, 3.0F, 6.0F);
  const std::vector<std::pair<std::string, std::string>> files = {
      {"a.pcd", XyzHeader("2", "ascii") + "1 2 3\n4 5 6\n"},
      {"b.pcd", XyzHeader("2", "binary") + data},
      {"c.pcd", XyzHeader("2", "binary_compressed") + Lzf(data)},
      {"d.ply", PlyHeader("ascii", "2") + "1 2 3\n4 5 6\n"},
      {"e.ply", PlyHeader("binary_little_endian", "2") + data}};
  const auto survives = [&](const std::string& name, const std::string& bytes) {
    const std::string path = WriteAnew(name, bytes);
    try {
      EXPECT_LE(ReadScanFile(path, options_.point_time_unit).points.size(), 100U);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(path));
    }
  };
  for (const auto& [name, good] : files) {
    for (std::size_t i = 0; i < good.size(); ++i) {
      survives(name, good.substr(0, i));
      for (const char c : {'\0', ' ', '\n', '9', '-', 'x', '\xff'}) {
        std::string bad = good;
        bad[i] = c;
        survives(name, bad);
      }
    }
  }
}

}  // namespace
}  // namespace lamina
