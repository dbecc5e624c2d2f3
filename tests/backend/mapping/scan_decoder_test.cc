// Scans as they are read for mapping: what contradicts is refused.
#include "backend/mapping/scan_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// 1000 points whose times run over `span_s`, one of them damaged.
Scan Sweep(double span_s) {
  Scan scan;
  for (int i = 0; i < 1000; ++i) {
    scan.points.push_back({5.0F + 0.01F * static_cast<float>(i), 1.0F, 0.0F, 0.0F});
    scan.time_s.push_back(static_cast<float>(span_s * i / 999.0));
  }
  scan.time_s[500] = 1e6F;
  return scan;
}

// The same scan again and again.
class SameScans final : public ScanSource {
 public:
  SameScans(const Scan& scan, StampNs apart_ns) : scan_(scan), apart_ns_(apart_ns) {}
  std::size_t size() const override { return 20; }
  std::string Name(std::size_t) const override { return "a.pcd"; }
  StampNs Stamp(std::size_t i) const override { return static_cast<StampNs>(i) * apart_ns_; }
  Scan Read(std::size_t i) const override {
    Scan scan = scan_;
    scan.stamp_ns = Stamp(i);
    return scan;
  }

 private:
  const Scan scan_;
  const StampNs apart_ns_;
};

MappedScan Decode(const Scan& scan, const ScanPreparationOptions& preparation,
                  StampNs apart_ns = 100'000'000) {
  const SameScans scans(scan, apart_ns);
  const MappedScan first = DecodeScan(scans, preparation, 10, 0.5, 0, 0).report;
  const MappedScan later = DecodeScan(scans, preparation, 10, 0.5, 0, 15).report;
  EXPECT_EQ(first.skipped, later.skipped);
  return later;
}

TEST(ScanDecoder, TimesThatAreNoneOfASweepAreRefused) {
  const ScanPreparationOptions preparation;
  EXPECT_FALSE(Decode(Sweep(0.1), preparation).skipped);
  EXPECT_FALSE(Decode(Sweep(0.2), preparation).skipped) << "two sweeps in one scan";
  EXPECT_FALSE(Decode(Sweep(0.5), preparation, 500'000'000).skipped) << "a slow sensor";
  // Microseconds that were taken for milliseconds, or numbers of the points.
  for (const double span_s : {100.0, 1.0}) {
    const MappedScan report = Decode(Sweep(span_s), preparation);
    EXPECT_TRUE(report.skipped);
    EXPECT_EQ(report.reason, SkipReason::kUnreadable);
    EXPECT_THAT(report.detail, AllOf(HasSubstr("a.pcd"), HasSubstr("scans are 0.1 s apart"),
                                     HasSubstr("point_time_unit")));
  }
}

TEST(ScanDecoder, TimesThatAreNotUsedOrHaveNothingToContradictAreNot) {
  ScanPreparationOptions preparation;
  preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  EXPECT_FALSE(Decode(Sweep(100.0), preparation).skipped);
  preparation.deskew = ScanPreparationOptions::Deskew::kAuto;
  Scan made_up = Sweep(5.0);
  made_up.stamp_made_up = true;
  EXPECT_FALSE(Decode(made_up, preparation).skipped);
  made_up.time_s = Sweep(100.0).time_s;
  EXPECT_THAT(Decode(made_up, preparation).detail, HasSubstr("no sweep lasts so long"));
}

}  // namespace
}  // namespace lamina
