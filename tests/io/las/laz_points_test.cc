// Records packed and unpacked, with all fields and channels in use.
#include "io/las/laz_points.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;

std::string Unpacked(const LazLayout& layout, const std::string& chunk, std::uint64_t points) {
  std::string records;
  UnpackLazChunk(layout, chunk, points, "chunk", [&](std::string_view record) {
    records += record;
    ASSERT_EQ(record.size(), layout.record_bytes());
  });
  return records;
}

// Of a flight with up to five returns a pulse; some fields change seldom, some at random.
std::string RecordsOfFormat6(int points, int channels) {
  std::mt19937 random(7);
  const auto chance = [&](unsigned one_in) { return random() % one_in == 0; };
  std::string records;
  double time = 5000.0;
  int returns = 1, number = 1;
  std::uint16_t angle = 0, source = 3;
  for (int i = 0; i < points; ++i) {
    if (number >= returns) {
      returns = chance(40) ? static_cast<int>(random() % 16) : 1 + static_cast<int>(random() % 5);
      number = chance(40) ? static_cast<int>(random() % 16) : 1;
      time += chance(300) ? 1e5 : chance(200) ? -0.5 : 1e-5;
    } else {
      number += chance(10) ? 2 : 1;
    }
    if (chance(7)) angle = static_cast<std::uint16_t>(angle + random() % 90 - 45);
    if (chance(50)) source = static_cast<std::uint16_t>(random());
    const auto wide = [&](int spread) {
      return static_cast<std::int32_t>(random() % (2U * static_cast<unsigned>(spread))) - spread;
    };
    const std::int32_t far = chance(100) ? wide(1'000'000'000) : 0;
    const auto channel = static_cast<unsigned>(channels > 1 ? random() % channels : 0);
    const auto flags =
        static_cast<std::uint8_t>((chance(9) ? random() & 0xCF : 0x40) | channel << 4);
    records += Pack(100 * i + far, wide(5000) - far, wide(300));
    records += Pack(static_cast<std::uint16_t>(chance(3) ? random() : 700),
                    static_cast<std::uint8_t>((number & 15) | (returns & 15) << 4), flags,
                    static_cast<std::uint8_t>(chance(5) ? random() : 2),
                    static_cast<std::uint8_t>(chance(5) ? random() : 0), angle, source, time);
  }
  return records;
}

TEST(LazPointsTest, EveryFieldOfFormat6ComesBack) {
  const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  for (const int channels : {1, 2, 4}) {
    for (const int points : {1, 2, 30, 20000}) {
      SCOPED_TRACE(std::to_string(points) + " points, channels " + std::to_string(channels));
      const std::string records = RecordsOfFormat6(points, channels);
      const std::string chunk = PackLazChunk(layout, records);
      EXPECT_TRUE(Unpacked(layout, chunk, static_cast<std::uint64_t>(points)) == records);
      EXPECT_LT(chunk.size(), points > 1000 ? 6 * records.size() / 10 : 200 + 2 * records.size());
    }
  }
}

// Points of a few scans in turns, each with the stamp of its scan: the bits of these are far apart
// or near.
TEST(LazPointsTest, TimesThatComeBackStayWhatTheyAre) {
  std::mt19937 random(5);
  for (const double start_s : {0.0, 5000.0, 1.3e9}) {
    for (const unsigned scans : {2U, 3U, 5U, 9U}) {
      SCOPED_TRACE(std::to_string(scans) + " scans from " + std::to_string(start_s));
      std::string newer, older;
      for (int i = 0; i < 20000; ++i) {
        const double time = start_s + 0.1 * static_cast<double>(random() % scans);
        const std::string head = Pack(i, 2 * i, 7, std::uint16_t{9}, std::uint8_t{0x11});
        newer += head + std::string(7, '\0') + Pack(time);
        older += head + std::string(5, '\0') + Pack(time);
      }
      const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints), layout1 = LazLayoutOfFormat1();
      EXPECT_TRUE(Unpacked(layout, PackLazChunk(layout, newer), 20000) == newer);
      EXPECT_TRUE(Unpacked(layout1, PackLazChunk(layout1, older), 20000) == older);
    }
  }
}

TEST(LazPointsTest, FieldsThatStayTheSameTakeNoBytes) {
  const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  std::string records;
  for (int i = 0; i < 1000; ++i) {
    records +=
        Pack(i, 2 * i, 7, std::uint16_t{9}, std::uint8_t{0x11}) + std::string(7, '\5') + Pack(1.0);
  }
  const std::string chunk = PackLazChunk(layout, records);
  // The lengths of nine layers stand behind the first record and the number of points.
  const std::string lengths = chunk.substr(34, 36);
  EXPECT_NE(lengths.substr(0, 4), std::string(4, '\0'));
  EXPECT_EQ(lengths.substr(4), std::string(32, '\0'));
  EXPECT_TRUE(Unpacked(layout, chunk, 1000) == records);
}

TEST(LazPointsTest, EveryFieldOfFormat1ComesBack) {
  const LazLayout layout = LazLayoutOfFormat1();
  const std::string newer = RecordsOfFormat6(20000, 1);
  std::string records;
  for (std::size_t at = 0; at < newer.size(); at += 30) {
    records += newer.substr(at, 18) + newer.substr(at + 20, 10);  // an angle of one byte
  }
  const std::string chunk = PackLazChunk(layout, records);
  EXPECT_TRUE(Unpacked(layout, chunk, 20000) == records);
}

TEST(LazPointsTest, LayersBehindThePointsArePassedOver) {
  LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  const std::string records = RecordsOfFormat6(50, 1);
  const std::string plain = PackLazChunk(layout, records);
  // The same with colours, and two extra bytes, in layers of rubbish.
  layout.items.push_back({kLazRgb14, 6, 3});
  layout.items.push_back({kLazByte14, 2, 3});
  std::string chunk = plain.substr(0, 30) + "colour78" + plain.substr(30, 40);
  chunk +=
      Pack(std::uint32_t{5}, std::uint32_t{0}, std::uint32_t{3}) + plain.substr(70) + "12345678";
  const std::string unpacked = Unpacked(layout, chunk, 50);
  for (std::size_t i = 0; i < 50; ++i) {
    EXPECT_EQ(unpacked.substr(38 * i, 30), records.substr(30 * i, 30)) << i;
    EXPECT_EQ(unpacked.substr(38 * i + 30, 8), std::string(8, '\0')) << i;
  }
}

TEST(LazPointsTest, TablesOfChunksOfAnyNumberOfPoints) {
  const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  const std::vector<LazChunk> chunks = {{10, 300}, {70000, 2'000'000}, {1, 34}};
  const std::string table = LazChunkTable(layout, chunks);
  const std::vector<LazChunk> read = ParseLazChunkTable(layout, table, 3, "table");
  ASSERT_EQ(read.size(), chunks.size());
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    EXPECT_EQ(read[i].points, chunks[i].points);
    EXPECT_EQ(read[i].bytes, chunks[i].bytes);
  }
  EXPECT_THROW(ParseLazChunkTable(layout, table, 2, "table"), InputError);
  EXPECT_THROW(ParseLazChunkTable(layout, table.substr(0, 10), 3, "table"), InputError);
}

TEST(LazPointsTest, DamagedLayersAreErrorsOrOtherPoints) {
  constexpr std::size_t kRecords = 150;
  const LazLayout layout = LazLayoutOfFormat6(kLazAnyPoints);
  const std::string good = PackLazChunk(layout, RecordsOfFormat6(kRecords, 3));
  for (std::size_t bytes = 0; bytes < good.size(); bytes += 1 + good.size() / 200) {
    EXPECT_THROW(Unpacked(layout, good.substr(0, bytes), kRecords), InputError) << bytes;
  }
  EXPECT_THAT(MessageOf<InputError>([&] { Unpacked(layout, good, kRecords + 1); }),
              HasSubstr("151 wanted"));
  std::mt19937 random(3);
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = good;
    for (int k = 0; k < 3; ++k) {
      damaged[random() % damaged.size()] ^= static_cast<char>(1U << random() % 8);
    }
    try {
      EXPECT_EQ(Unpacked(layout, damaged, kRecords).size(), kRecords * 30U);
    } catch (const InputError&) {
    }
  }
}

}  // namespace
}  // namespace lamina
