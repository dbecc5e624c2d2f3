// LAS files as scans.
#include "io/points/las_scan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/las/laz_points.h"
#include "io/map/map_io.h"
#include "io/points/scan_file.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/peak_memory.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

struct LasPoint {
  std::int32_t x = 0, y = 0, z = 0;
  double time_s = 0.0;
  bool withheld = false;
};

class LasScanTest : public FilesTest {
 protected:
  // `extra` bytes behind the fields that the format has.
  static std::string Las(int minor, int format, const std::vector<LasPoint>& points,
                         std::size_t extra = 0) {
    const std::size_t sizes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
    const std::size_t record = sizes[format] + extra;
    std::string las(minor == 4 ? 375 : 227, '\0');
    const auto set = [&](std::size_t at, const std::string& bytes) {
      las.replace(at, bytes.size(), bytes);
    };
    const std::string behind(50, '\x33');
    set(0, "LASF");
    set(24, Pack(std::uint8_t{1}, static_cast<std::uint8_t>(minor)));
    set(94, Pack(static_cast<std::uint16_t>(las.size()),
                 static_cast<std::uint32_t>(las.size() + behind.size())));
    set(104, Pack(static_cast<std::uint8_t>(format), static_cast<std::uint16_t>(record)));
    const auto count = static_cast<std::uint32_t>(points.size());
    set(107, Pack(format < 6 ? count : 0U));
    set(131, Pack(0.01, 0.01, 0.002) + Pack(10.0, 0.0, -1.0));
    if (minor == 4) set(247, Pack(std::uint64_t{count}));
    las += behind;
    for (const LasPoint& p : points) {
      std::string bytes(record, '\0');
      bytes.replace(0, 14, Pack(p.x, p.y, p.z, std::uint16_t{300}));
      if (p.withheld) bytes[15] = static_cast<char>(format < 6 ? 0x80 : 0x04);
      const std::size_t time_at = format >= 6 ? 22 : format == 0 || format == 2 ? 0 : 20;
      if (time_at > 0) bytes.replace(time_at, 8, Pack(p.time_s));
      las += bytes;
    }
    return las;
  }
  Scan Read(const std::string& bytes) const { return ReadScanFile(Write("a.las", bytes), {}); }
  std::string MessageOfReading(const std::string& bytes) const {
    return MessageOf<InputError>([&] { Read(bytes); });
  }
  const std::vector<LasPoint> points_ = {
      {100, 200, 1000, 5000.0}, {1, 1, 1, 5000.01, true}, {-100, 0, -500, 5000.1}};
};

TEST_F(LasScanTest, EveryFormatOfEveryVersion) {
  for (int format = 0; format <= 10; ++format) {
    for (int minor = format < 6 ? 0 : 4; minor <= 4; ++minor) {
      SCOPED_TRACE(std::to_string(minor) + " " + std::to_string(format));
      const Scan scan = Read(Las(minor, format, points_, format % 3));
      ASSERT_THAT(scan.points, SizeIs(2));
      EXPECT_NEAR(scan.points[0].x, 11.0, 1e-5);
      EXPECT_NEAR(scan.points[0].y, 2.0, 1e-6);
      EXPECT_NEAR(scan.points[1].z, -2.0, 1e-6);
      EXPECT_EQ(scan.points[1].intensity, 300.0F);
      if (format == 0 || format == 2) {
        EXPECT_THAT(scan.time_s, IsEmpty());
        continue;
      }
      EXPECT_EQ(scan.stamp_ns, 5000'000'000'000);
      ASSERT_THAT(scan.time_s, SizeIs(2));
      EXPECT_NEAR(scan.time_s[1], 0.1, 1e-6);
    }
  }
}

TEST_F(LasScanTest, AFolderOfThemIsARecording) {
  Write("in/1.las", Las(2, 1, {{100, 0, 0, 7.0 + 1000.0}, {200, 0, 0, 7.1 + 1000.0}}));
  Write("in/2.las", Las(2, 1, {{100, 0, 0, 7.1 + 1000.0}, {200, 0, 0, 7.2 + 1000.0}}));
  const auto scans = OpenScans(Path("in"), {});
  ASSERT_EQ(scans->size(), 2U);
  EXPECT_EQ(scans->Stamp(1), 1007'100'000'000);
  EXPECT_NEAR(scans->Read(1).time_s[1], 0.1, 1e-5);
}

TEST_F(LasScanTest, WhatIsExportedIsReadAgain) {
  CloudWriter writer(Path("c.las"));
  writer.Append({{{1, -2, 3}, 0.5F, 100.0}, {{4, 5, 6}, 1.0F, 100.05}});
  writer.Commit();
  const Scan scan = ReadScanFile(Path("c.las"), {});
  ASSERT_THAT(scan.points, SizeIs(2));
  EXPECT_NEAR(scan.points[0].y, -2.0, 1e-4);
  EXPECT_NEAR(scan.time_s[1], 0.05, 1e-5);
}

TEST_F(LasScanTest, WhatContradictsIsAClearError) {
  const std::string good = Las(4, 6, points_);
  const auto with = [&](std::size_t at, const std::string& bytes) {
    std::string changed = good;
    return changed.replace(at, bytes.size(), bytes);
  };
  EXPECT_THAT(MessageOfReading("LAS"), HasSubstr("no LAS file"));
  EXPECT_THAT(MessageOfReading(with(0, "LASX")), HasSubstr("no LAS file"));
  EXPECT_THAT(MessageOfReading(with(25, "\x05")), HasSubstr("version 1.5"));
  EXPECT_THAT(MessageOfReading(with(104, "\x0B")), HasSubstr("format 11"));
  EXPECT_THAT(MessageOfReading(with(104, "\x86")), HasSubstr("nothing tells how"));
  EXPECT_THAT(MessageOfReading(with(105, Pack(std::uint16_t{29}))), HasSubstr("at least 30"));
  EXPECT_THAT(MessageOfReading(with(105, Pack(std::uint16_t{0}))), HasSubstr("at least 30"));
  EXPECT_THAT(MessageOfReading(with(247, Pack(~std::uint64_t{0}))), HasSubstr("truncated"));
  EXPECT_THAT(MessageOfReading(with(96, Pack(~std::uint32_t{0}))), HasSubstr("truncated"));
  EXPECT_THAT(MessageOfReading(with(96, Pack(std::uint32_t{10}))), HasSubstr("within the header"));
  EXPECT_THAT(MessageOfReading(with(131, Pack(std::nan("")))), HasSubstr("no number"));
  EXPECT_THAT(MessageOfReading(with(155, Pack(637012.0, 849028.0, 431.0))), HasSubstr("a map"));
  EXPECT_THAT(MessageOfReading(Las(2, 1, {{1, 1, 1, std::nan("")}})), HasSubstr("finite GPS time"));
  EXPECT_THAT(MessageOfReading(Las(2, 1, {})), HasSubstr("empty"));
  for (std::size_t bytes = 0; bytes < good.size(); bytes += 7) {
    EXPECT_NE(MessageOfReading(good.substr(0, bytes)), "");
  }
}

TEST_F(LasScanTest, HeadersSayHowLongTheFileMustBe) {
  for (const int minor : {0, 2, 4}) {
    const std::string las = Las(minor, 1, {{1, 2, 3, 5.0}});
    for (std::size_t bytes = 0; bytes <= las.size(); ++bytes) {
      const auto declared = DeclaredLasBytes(std::string_view(las).substr(0, bytes));
      EXPECT_EQ(declared && bytes >= *declared, bytes == las.size()) << minor << " " << bytes;
    }
  }
  EXPECT_EQ(DeclaredLasBytes(Las(4, 6, points_).replace(25, 1, "\x05")), 0U);
  CloudWriter writer(Path("c.laz"));
  writer.Append({{{1, -2, 3}, 0.5F, 100.0}, {{4, 5, 6}, 1.0F, 100.05}});
  writer.Commit();
  std::string laz = Bytes(Path("c.laz"));
  std::uint32_t points_at = 0;
  laz.copy(reinterpret_cast<char*>(&points_at), sizeof(points_at), 96);
  std::uint64_t table = 0;
  laz.copy(reinterpret_cast<char*>(&table), sizeof(table), points_at);
  EXPECT_EQ(DeclaredLasBytes(laz), table + 8);
  EXPECT_FALSE(IsWholeScanFile(Write("half.laz", laz.substr(0, table)), table));
  EXPECT_TRUE(IsWholeScanFile(Path("c.laz"), laz.size()));
  // As it stands until the last chunk is written.
  laz.replace(points_at, 8, std::string(8, '\xFF'));
  EXPECT_FALSE(IsWholeScanFile(Write("open.LAZ", laz), laz.size()));
}

TEST_F(LasScanTest, PackedFilesGiveTheSamePoints) {
  std::vector<CloudPoint> points;
  std::uint32_t random = 5;
  const auto next = [&] { return random = random * 1664525 + 1013904223, random >> 8; };
  double stamp_s = 1317042164.2;
  for (int i = 0; i < 120000; ++i) {
    // Rings of a sweep; now and then a stray, another time, a far jump in time.
    const double angle = 0.001 * i, range_m = 10.0 + 1e-4 * (next() % 1000);
    CloudPoint point{{range_m * std::cos(angle), range_m * std::sin(angle), 1e-4 * (next() % 500)},
                     static_cast<float>(next() % 256),
                     stamp_s};
    if (i % 997 == 0) point.p.x() += 300.0 * (next() % 100);
    points.push_back(point);
    stamp_s += i % 5000 == 0 ? 1e6 : i % 700 == 0 ? -0.3 : i % 3 == 0 ? 0.0 : 1e-6 * (next() % 4);
  }
  for (const std::size_t count : {1U, 2U, 50000U, 120000U}) {
    std::string bytes[2];
    for (const bool packed : {false, true}) {
      const std::string path = Path(packed ? "c.laz" : "c.las");
      CloudWriter writer(path);
      for (std::size_t at = 0; at < count; at += 7777) {
        const std::size_t end = std::min<std::size_t>(at + 7777, count);
        writer.Append(std::vector<CloudPoint>(points.begin() + static_cast<std::ptrdiff_t>(at),
                                              points.begin() + static_cast<std::ptrdiff_t>(end)));
      }
      writer.Commit();
      bytes[packed ? 1 : 0] = Bytes(path);
    }
    const Scan plain = ReadScanFile(Path("c.las"), {}), packed = ReadScanFile(Path("c.laz"), {});
    ASSERT_EQ(plain.points.size(), count);
    ASSERT_EQ(packed.points.size(), count);
    EXPECT_EQ(std::memcmp(plain.points.data(), packed.points.data(), 16 * count), 0);
    EXPECT_EQ(plain.time_s, packed.time_s);
    EXPECT_EQ(plain.stamp_ns, packed.stamp_ns);
    if (count > 1000) {
      EXPECT_LT(3 * bytes[1].size(), bytes[0].size());
    }
  }
}

// Of each kind that is written; the third is cut in nodes of an octree.
TEST_F(LasScanTest, DamagedFilesGiveErrorsOrOtherPointsAndNoCrash) {
  std::vector<CloudPoint> points;
  for (int i = 0; i < 900; ++i) points.push_back({{0.01 * i, 5.0, 0.1 * (i % 7)}, 3.0F, 0.001 * i});
  for (const std::string name : {"c.las", "c.laz", "c.copc.laz"}) {
    SCOPED_TRACE(name);
    CloudWriter writer(Path(name));
    writer.Append(points);
    writer.Commit();
    const std::string good = Bytes(Path(name));
    const ExpectBoundedMemory bounded;
    EXPECT_EQ(ReadScanFile(Path(name), {}).points.size(), 900U);
    // Behind the points of a COPC file are its hierarchy and its table, and no table is a clear
    // end.
    for (std::size_t cut = 0; cut < 100; ++cut) {
      const std::string path = WriteAnew("d" + name, good.substr(0, good.size() * cut / 100));
      try {
        const std::size_t read = ReadScanFile(path, {}).points.size();
        EXPECT_TRUE(name == "c.copc.laz" && read == 900U) << cut << " " << read;
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr(path));
      }
    }
    std::uint32_t random = 3;
    for (int i = 0; i < 600; ++i) {
      random = random * 1664525 + 1013904223;
      std::string damaged = good;
      // A third of them in the header and the records behind it.
      const std::size_t within = i % 3 == 0 ? 500 : damaged.size();
      damaged[(random >> 8) % within] ^= static_cast<char>(1U << (random >> 29));
      const std::string path = WriteAnew("d" + name, damaged);
      try {
        EXPECT_LE(ReadScanFile(path, {}).points.size(), 2'000'000U);
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr(path));
      }
    }
  }
}

class HostileLazTest : public LasScanTest {
 protected:
  // A file of 300 points, of which the header says that there are so many and the record of the
  // compressor that a chunk has so many, with such a table of chunks.
  std::string Laz(std::uint64_t points, std::uint32_t chunk_points,
                  const std::string& table) const {
    CloudWriter writer(Path("c.laz"));
    for (int i = 0; i < 300; ++i)
      writer.Append({{{0.01 * i, 5.0, 0.1 * (i % 7)}, 3.0F, 0.001 * i}});
    writer.Commit();
    std::string laz = Bytes(Path("c.laz"));
    const std::size_t record = laz.find("laszip encoded") - 2 + 54;
    laz.replace(record + 12, 4, Pack(chunk_points));
    laz.replace(247, 8, Pack(points));
    std::uint32_t points_at = 0;
    laz.copy(reinterpret_cast<char*>(&points_at), sizeof(points_at), 96);
    std::uint64_t table_at = 0;
    laz.copy(reinterpret_cast<char*>(&table_at), sizeof(table_at), points_at);
    return table.empty() ? laz : laz.substr(0, static_cast<std::size_t>(table_at)) + table;
  }
  std::string MessageOfLaz(const std::string& bytes) const {
    const std::string path = Write("d.laz", bytes);
    const ExpectBoundedMemory bounded;
    return MessageOf<InputError>([&] { ReadScanFile(path, {}); });
  }
};

TEST_F(HostileLazTest, CountsOfPointsAndChunksAreHeldAgainstTheFile) {
  EXPECT_THAT(MessageOfLaz(Laz(20'000'001, 50'000, "")), HasSubstr("at most 20000000"));
  EXPECT_THAT(MessageOfLaz(Laz(19'000'000, 50'000, "")), HasSubstr("cannot have 19000000 points"));
  // Each point a chunk, of no bytes to speak of.
  const std::string zeros(4000, '\0');
  for (const std::uint32_t count : {0xFFFFFFFFU, 1'000'000U, 500U}) {
    const std::string table = Pack(0U, count) + zeros;
    EXPECT_THAT(MessageOfLaz(Laz(1'000'000, 1, table)),
                HasSubstr("chunks of compressed points for"));
    EXPECT_THAT(MessageOfLaz(Laz(1'000'000, 0xFFFFFFFFU, table)),
                HasSubstr("chunks of compressed points for"));
  }
  // Fewer than there are points for, none, or none that tells its length.
  EXPECT_THAT(MessageOfLaz(Laz(300, 50'000, Pack(0U, 0U))), HasSubstr("lacks some of its chunks"));
  EXPECT_THAT(MessageOfLaz(Laz(300, 50'000, Pack(0U, 1U))), HasSubstr("end early"));
  EXPECT_THAT(MessageOfLaz(Laz(300, 50'000, Pack(7U, 1U))), HasSubstr("is damaged"));
  EXPECT_THAT(MessageOfLaz(Laz(300, 50'000, "abc")), HasSubstr("is damaged"));
  // Chunks that are longer than the file, or of more points than there are.
  LazLayout layout = LazLayoutOfFormat6(50'000);
  LazChunk chunk;
  chunk.bytes = 1U << 30;
  EXPECT_THAT(MessageOfLaz(Laz(300, 50'000, LazChunkTable(layout, {chunk}))),
              HasSubstr("longer than the file"));
  layout.chunk_points = kLazAnyPoints;
  chunk = {1U << 30, 100};
  EXPECT_THAT(MessageOfLaz(Laz(300, kLazAnyPoints, LazChunkTable(layout, {chunk}))),
              HasSubstr("more points than the header says"));
}

// More bytes than memory should be taken for, in a file of some hundred.
TEST_F(LasScanTest, RecordsOfManyBytesDoNotFillMemory) {
  std::string las = Las(4, 6, {{1, 2, 3, 5.0}});
  las[104] = '\x86';
  las.replace(105, 2, Pack(std::uint16_t{60000}));
  las.replace(247, 8, Pack(std::uint64_t{1'000'000}));
  EXPECT_THAT(MessageOfReading(las), HasSubstr("of 60000 bytes"));
}

// Files of another program's tests.
TEST_F(LasScanTest, RealFiles) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  const std::string folder = std::string(recordings == nullptr ? "" : recordings) + "/formats/las/";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "LAMINA_RECORDINGS has no formats/las";
  const auto message = [&](const std::string& name) {
    return MessageOf<InputError>([&] { ReadScanFile(folder + name, {}); });
  };
  for (const char* map : {"1.2-with-color.las", "extrabytes.las", "test1_4.las"}) {
    EXPECT_THAT(message(map), HasSubstr("a map")) << map;
  }
  EXPECT_THAT(message("gps-time-nan.las"), HasSubstr("finite GPS time"));
  // The same points as in the first of the maps above, moved near the origin by the header alone.
  for (const char* name : {"1.2-with-color.las", "simple.laz", "1.2-with-color.copc.laz"}) {
    std::string bytes = Bytes(folder + name);
    double offset[3];
    std::memcpy(offset, bytes.data() + 155, sizeof(offset));
    bytes.replace(155, 24, Pack(offset[0] - 637000.0, offset[1] - 849000.0, offset[2] - 400.0));
    const Scan scan = ReadScanFile(Write(std::string("near_") + name, bytes), {});
    ASSERT_EQ(scan.points.size(), 1065U) << name;
    double sum[3] = {};
    for (const ScanPoint& p : scan.points) sum[0] += p.x, sum[1] += p.y, sum[2] += p.z;
    EXPECT_NEAR(sum[0] / 1065, 637296.7352 - 637000, 1e-3) << name;
    EXPECT_NEAR(sum[1] / 1065, 851249.5385 - 849000, 1e-3) << name;
    EXPECT_NEAR(sum[2] / 1065, 434.0978 - 400, 1e-3) << name;
    const auto [low, high] = std::minmax_element(scan.time_s.begin(), scan.time_s.end());
    EXPECT_NEAR(*high - *low, 249783.162 - 245370.417, 0.01) << name;
  }
}

}  // namespace
}  // namespace lamina
