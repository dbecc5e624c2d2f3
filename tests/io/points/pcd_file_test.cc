// Point files .pcd, sound and damaged.
#include <cmath>
#include <vector>

#include "tests/io/points/scan_file_fixture.h"

namespace lamina {
namespace {

using testing::ElementsAre;
using testing::FloatNear;
using testing::HasSubstr;
using testing::Pointwise;

class PcdFileTest : public ScanFileTest {};

TEST_F(PcdFileTest, AsciiWithTimes) {
  const Scan scan =
      Read("a.pcd", PcdHeader("x y z reflectivity t", "8 8 8 1 4", "F F F U U", "3", "ascii") +
                        "1 2 3 200 0\n-1e-1 nan 6 7 50000000\n7 8 9 0 100000000\n");
  ASSERT_EQ(scan.points.size(), 3U);
  ExpectPoint(scan.points[0], 1, 2, 3, 200);
  EXPECT_EQ(scan.points[1].x, -0.1F);
  EXPECT_TRUE(std::isnan(scan.points[1].y));
  // What is no return has no time.
  EXPECT_THAT(scan.time_s, ElementsAre(0.0F, testing::IsNan(), FloatNear(0.1F, 1e-7F)));
}

// An organised cloud has zeros for pulses without a return, beside times since an epoch.
TEST_F(PcdFileTest, TimesAreThoseOfReturns) {
  const Scan scan =
      Read("a.pcd", PcdHeader("x y z timestamp", "4 4 4 8", "F F F F", "4", "ascii") +
                        "nan nan nan 0\n1 2 3 1700000000.25\n0 0 0 0\n4 5 6 1700000000.125\n");
  EXPECT_EQ(scan.stamp_ns, 1700000000125000000);
  EXPECT_THAT(scan.time_s,
              ElementsAre(testing::IsNan(), FloatNear(0.125F, 1e-6F), testing::IsNan(), 0.0F));
}

TEST_F(PcdFileTest, BinaryWithEpochStampsInDouble) {
  const std::string header =
      PcdHeader("x y z intensity timestamp", "4 4 4 4 8", "F F F F F", "2", "binary");
  const Scan scan = Read("a.pcd", header + Pack(1.0F, 2.0F, 3.0F, 0.5F, 1700000000.25, 4.0F, 5.0F,
                                                6.0F, 0.25F, 1700000000.125));
  ASSERT_EQ(scan.points.size(), 2U);
  ExpectPoint(scan.points[1], 4, 5, 6, 0.25F);
  EXPECT_EQ(scan.stamp_ns, 1700000000125000000);
  EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-7F), {0.125F, 0.0F}));
}

TEST_F(PcdFileTest, BinaryWithPaddingAndNanosecondsIn64Bits) {
  const std::string header =
      Replaced(PcdHeader("x _ y z t", "4 1 4 4 8", "F U F F U", "2", "binary"), "WIDTH",
               "COUNT 1 3 1 1 1\nWIDTH");
  const auto point = [](float x, std::uint64_t ns) {
    return Pack(x, '?', '?', '?', 2.0F, 3.0F, ns);
  };
  const Scan scan =
      Read("a.pcd", header + point(1, 1700000000000000001) + point(4, 1700000000100000001));
  ExpectPoint(scan.points[1], 4, 2, 3, 0);
  EXPECT_EQ(scan.stamp_ns, 1700000000000000001);
  EXPECT_FLOAT_EQ(scan.time_s[1], 0.1F);
}

TEST_F(PcdFileTest, TimeFieldsOfManyNamesTypesAndUnits) {
  const auto read = [&](const std::string& name, const std::string& size, const std::string& type,
                        const std::string& data) {
    const Scan scan =
        Read("a.pcd",
             PcdHeader("x y z " + name, "4 4 4 " + size, "F F F " + type, "2", "binary") + data);
    return scan.time_s.empty() ? -1.0F : scan.time_s[1];
  };
  const std::string p = Pack(1.0F, 2.0F, 3.0F);
  EXPECT_FLOAT_EQ(read("time", "4", "F", p + Pack(0.0F) + p + Pack(0.1F)), 0.1F);
  EXPECT_FLOAT_EQ(read("Timestamp", "8", "F", p + Pack(0.0) + p + Pack(100.0)), 0.1F);
  EXPECT_FLOAT_EQ(read("offset_time", "4", "U", p + Pack(0U) + p + Pack(100000U)), 0.1F);
  EXPECT_FLOAT_EQ(read("time_offset", "4", "I", p + Pack(0) + p + Pack(-100)), -0.1F);
  EXPECT_FLOAT_EQ(read("ts", "2", "U", p + Pack(std::uint16_t{0}) + p + Pack(std::uint16_t{100})),
                  0.1F);
  EXPECT_FLOAT_EQ(read("point_time_offset", "4", "F", p + Pack(0.0F) + p + Pack(1e8F)), 0.1F);
  EXPECT_FLOAT_EQ(read("stripes", "4", "F", p + Pack(0.0F) + p + Pack(0.1F)), -1.0F);
  options_.point_time_unit = PointTimeUnit::kMilliseconds;
  EXPECT_FLOAT_EQ(read("t", "4", "F", p + Pack(0.0F) + p + Pack(0.5F)), 0.0005F);
}

// Who prepares the scan drops it: the others are as good.
TEST_F(PcdFileTest, APointWithoutTimeCostsNoOther) {
  const std::string header = PcdHeader("x y z t", "4 4 4 4", "F F F F", "3", "ascii");
  for (const char* second : {"1 2 3 nan\n", "nan 2 3 nan\n"}) {
    const Scan scan = Read("a.pcd", header + "1 2 3 0\n" + second + "1 2 3 0.1\n");
    ASSERT_EQ(scan.time_s.size(), 3U);
    EXPECT_EQ(scan.time_s[0], 0.0F);
    EXPECT_TRUE(std::isnan(scan.time_s[1]));
    EXPECT_FLOAT_EQ(scan.time_s[2], 0.1F);
  }
}

TEST_F(PcdFileTest, AsciiKeepsNanosecondsIn64Bits) {
  const Scan scan = Read("a.pcd", PcdHeader("x y z t", "4 4 4 8", "F F F U", "2", "ascii") +
                                      "1 2 3 1700000000123456789\n4 5 6 1700000000223456789\n");
  EXPECT_EQ(scan.stamp_ns, 1700000000123456789);
  EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-7F), {0.0F, 0.1F}));
}

TEST_F(PcdFileTest, Compressed) {
  // Compressed data stand field by field.
  const std::string data = Pack(1.0F, 4.0F, 2.0F, 5.0F, 3.0F, 6.0F, 7.0F, 8.0F);
  const std::string header =
      PcdHeader("x y z intensity", "4 4 4 4", "F F F F", "2", "binary_compressed");
  const Scan scan = Read("a.pcd", header + Lzf(data));
  ASSERT_EQ(scan.points.size(), 2U);
  ExpectPoint(scan.points[0], 1, 2, 3, 7);
  ExpectPoint(scan.points[1], 4, 5, 6, 8);

  EXPECT_THAT(ReadError("b.pcd", header + Lzf(data + "1234")), HasSubstr("unpack to 36"));
  EXPECT_THAT(ReadError("c.pcd", header + Lzf(data).substr(0, 20)), HasSubstr("announced"));
  EXPECT_THAT(ReadError("d.pcd", header + "1234"), HasSubstr("two sizes"));
  std::string damaged = Lzf(data);
  damaged[8] = '\x7f';  // a reference to what came before the beginning
  EXPECT_THAT(ReadError("e.pcd", header + damaged), HasSubstr("e.pcd"));
}

TEST_F(PcdFileTest, Truncated) {
  const std::string p = Pack(1.0F, 2.0F, 3.0F);
  EXPECT_THAT(ReadError("a.pcd", XyzHeader("3", "binary") + p + p + p.substr(1)),
              AllOf(HasSubstr("a.pcd:10:"), HasSubstr("need 36 bytes"), HasSubstr("has 35")));
  EXPECT_THAT(ReadError("b.pcd", XyzHeader("2", "ascii") + "1 2 3\n"),
              HasSubstr("ends after 1 of 2 points"));
  EXPECT_THAT(ReadError("c.pcd", XyzHeader("1", "ascii").substr(0, 60)), HasSubstr("c.pcd"));
}

TEST_F(PcdFileTest, WithAbsurdPoints) {
  for (const char* points : {"4294967295", "1000000000", "99999999999999999999", "-1", "1e3"}) {
    for (const char* data : {"ascii", "binary", "binary_compressed"}) {
      const std::string body = Pack(100U, 0xffffffffU) + std::string(100, '1');
      EXPECT_THAT(ReadError("a.pcd", XyzHeader(points, data) + body), HasSubstr("a.pcd:"))
          << points << " " << data;
    }
  }
  // 65536 * 65536 is 0 in 32 bits.
  std::string header = Replaced(XyzHeader("65536", "binary"), "HEIGHT 1", "HEIGHT 65536");
  EXPECT_THAT(ReadError("b.pcd", Replaced(header, "POINTS 65536", "POINTS 0")),
              HasSubstr("WIDTH 65536 times HEIGHT 65536"));
}

TEST_F(PcdFileTest, HeaderLinesThatBreakTheRulesAreNamed) {
  const std::string good = XyzHeader("1", "ascii") + "1 2 3\n";
  EXPECT_EQ(Read("good.pcd", good).points.size(), 1U);
  const auto error = [&](const std::string& from, const std::string& to) {
    return ReadError("a.pcd", Replaced(good, from, to));
  };
  EXPECT_THAT(error("SIZE 4 4 4", "SIZE 4 4"), AllOf(HasSubstr("a.pcd:4:"), HasSubstr("found 2")));
  EXPECT_THAT(error("SIZE 4 4 4", "SIZE 4 4 3"), HasSubstr("1, 2, 4 or 8"));
  EXPECT_THAT(error("TYPE F F F", "TYPE F F X"), AllOf(HasSubstr("a.pcd:5:"), HasSubstr("TYPE")));
  EXPECT_THAT(error("FIELDS x y z", "FIELDS"), HasSubstr("names no field"));
  EXPECT_THAT(error("FIELDS x y z\n", ""), HasSubstr("found 3"));
  EXPECT_THAT(error("WIDTH 1", "WIDTH"), HasSubstr("found 0"));
  EXPECT_THAT(error("WIDTH 1\n", ""), HasSubstr("without WIDTH"));
  EXPECT_THAT(error("POINTS 1\n", ""), HasSubstr("without POINTS"));
  EXPECT_THAT(error("HEIGHT 1", "HEIGHT 1\nHEIGHT 1"), HasSubstr("again"));
  EXPECT_THAT(error("HEIGHT 1", "HEIGHT 1\nCOUNT 1 1 0"), HasSubstr("COUNT"));
  EXPECT_THAT(error("DATA ascii", "DATA text"), HasSubstr("DATA must be"));
  EXPECT_THAT(error("VERSION", "VERSUCH"), HasSubstr("no line of a PCD header"));
  EXPECT_THAT(error("FIELDS x y z", "FIELDS x y w"), HasSubstr("no field 'z'"));
  EXPECT_THAT(error("TYPE F F F", "TYPE F F I"), HasSubstr("'z' must be float"));
  EXPECT_THAT(error("1 2 3\n", "1 2\n"), AllOf(HasSubstr("a.pcd:11:"), HasSubstr("found 2")));
  EXPECT_THAT(error("1 2 3\n", "1 2 drei\n"), HasSubstr("'drei'"));
}

}  // namespace
}  // namespace lamina
