// LAZ and COPC as other programs read them: npm's laz-perf and copc, in the node_modules of the
// folder that LAMINA_ORACLES names (npm install --prefix FOLDER copc laz-perf).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "io/map/map_io.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/oracles.h"

namespace lamina {
namespace {

class LasOracleTest : public FilesTest {
 protected:
  static constexpr std::size_t kRecordBytes = 30;
  static std::vector<CloudPoint> Spiral(bool by_scan) {
    std::vector<CloudPoint> points;
    std::uint32_t random = 5;
    const auto next = [&] { return random = random * 1664525 + 1013904223, random >> 8; };
    for (int i = 0; i < 130'000; ++i) {
      const double angle = 0.002 * i, range_m = 10.0 + 1e-3 * i + 1e-4 * (next() % 1000);
      const double stamp_s =
          by_scan ? 1.3e9 + 0.1 * (next() % 7) : 1.3e9 + 1e-5 * i + (i % 5000 == 0 ? 1e6 : 0.0);
      points.push_back({{4e6 + range_m * std::cos(angle), range_m * std::sin(angle), 1e-4 * next()},
                        static_cast<float>(next() % 256),
                        stamp_s});
    }
    return points;
  }
  static std::vector<std::string> Records(const std::string& bytes, std::size_t begin) {
    std::vector<std::string> records;
    for (std::size_t at = begin; at < bytes.size(); at += kRecordBytes) {
      records.push_back(bytes.substr(at, kRecordBytes));
    }
    std::sort(records.begin(), records.end());
    return records;
  }
};

TEST_F(LasOracleTest, LazAndCopcHoldTheRecordsOfLas) {
  const std::string node = NodeWithOracles();
  if (node.empty()) GTEST_SKIP() << "LAMINA_ORACLES is unset: no laz-perf, no copc";
  // Times of points each, or of a few scans in turns.
  for (const bool by_scan : {false, true}) {
    const std::vector<CloudPoint> points = Spiral(by_scan);
    std::vector<std::string> expected;
    for (const char* name : {"c.las", "c.laz", "c.copc.laz"}) {
      CloudWriter writer(Path(name));
      writer.Append(points);
      writer.Commit();
      if (name == std::string("c.las")) {
        const std::string las = Bytes(Path(name));
        std::uint32_t begin = 0;
        std::memcpy(&begin, las.data() + 96, sizeof(begin));
        expected = Records(las, begin);
        continue;
      }
      ASSERT_TRUE(RunOracle(node, "las_records.cjs", {Path(name), Path("records")})) << name;
      EXPECT_TRUE(Records(Bytes(Path("records")), 0) == expected) << name;
    }
  }
}

}  // namespace
}  // namespace lamina
