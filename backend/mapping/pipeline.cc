#include "backend/mapping/pipeline.h"

#include <utility>
#include <vector>

#include "core/base/parallel.h"

namespace lamina {
namespace {

// The way of a scan: read ahead, then mapped in order.
class ScanStages final : public PipelineStages {
 public:
  ScanStages(const ScanSource& source, const ScanRange& range, const std::atomic<bool>* stop,
             const std::function<void(const MappedScan&)>& on_scan, Mapping* mapping)
      : source_(source),
        range_(range),
        stop_(stop),
        on_scan_(on_scan),
        mapping_(mapping),
        under_way_(static_cast<std::size_t>(mapping->options().pipeline.lookahead_scans)) {}

  bool Begin(std::size_t i) override {
    return range_.next + i < range_.end && (stop_ == nullptr || !stop_->load());
  }
  void Work(std::size_t i) override {
    Slot(i) = mapping_->Decode(source_, range_.begin, range_.next + i);
  }
  void End(std::size_t i) override {
    const MappedScan report = mapping_->Add(std::exchange(Slot(i), {}));
    if (on_scan_) on_scan_(report);
    ++processed_;
  }

  std::size_t processed() const { return processed_; }

 private:
  DecodedScan& Slot(std::size_t i) { return under_way_[i % under_way_.size()]; }

  const ScanSource& source_;
  const ScanRange range_;
  const std::atomic<bool>* stop_;
  const std::function<void(const MappedScan&)>& on_scan_;
  Mapping* mapping_;
  std::vector<DecodedScan> under_way_;
  std::size_t processed_ = 0;
};

}  // namespace

std::size_t MapScans(const ScanSource& source, const ScanRange& range, Mapping* mapping,
                     const std::atomic<bool>* stop,
                     const std::function<void(const MappedScan&)>& on_scan) {
  ScanStages stages(source, range, stop, on_scan, mapping);
  RunPipeline(static_cast<std::size_t>(mapping->options().pipeline.lookahead_scans), &stages);
  return stages.processed();
}

}  // namespace lamina
