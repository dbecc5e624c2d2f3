#include "backend/mapping/pipeline.h"

#include <utility>

#include "backend/mapping/serial_mapping.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

// What the first stage hands to the second.
struct PipelineScan {
  ScanReport report;
  std::vector<TimedCluster> clusters;
};

PipelineScan Decode(const ScanSource& source, const MappingOptions& options, std::size_t begin,
                    std::size_t i) {
  DecodedScan decoded = DecodeScan(source, options.preparation, options.pipeline.min_points,
                                   options.mapper.map.LeafSize(), begin, i);
  PipelineScan scan;
  static_cast<ScanDecodeReport&>(scan.report) = std::move(decoded.report);
  scan.clusters = std::move(decoded.clusters);
  return scan;
}

}  // namespace

// The way of a scan: read ahead, then mapped in order.
class MappingPipeline::ScanStages final : public PipelineStages {
 public:
  ScanStages(const ScanSource& source, const ScanRange& range, const std::atomic<bool>* stop,
             const MappingOptions& options, SerialMapping* serial)
      : source_(source),
        range_(range),
        stop_(stop),
        options_(options),
        serial_(serial),
        under_way_(static_cast<std::size_t>(options.pipeline.lookahead_scans)) {}

  bool Begin(std::size_t i) override {
    return range_.next + i < range_.end && (stop_ == nullptr || !stop_->load());
  }
  void Work(std::size_t i) override {
    Slot(i) = Decode(source_, options_, range_.begin, range_.next + i);
  }
  void End(std::size_t i) override {
    serial_->Process(&Slot(i).report, &Slot(i).clusters);
    Slot(i) = PipelineScan();
    ++processed_;
  }

  std::size_t processed() const { return processed_; }

 private:
  PipelineScan& Slot(std::size_t i) { return under_way_[i % under_way_.size()]; }

  const ScanSource& source_;
  const ScanRange range_;
  const std::atomic<bool>* stop_;
  const MappingOptions& options_;
  SerialMapping* serial_;
  std::vector<PipelineScan> under_way_;
  std::size_t processed_ = 0;
};

MappingPipeline::MappingPipeline(const MappingOptions& options, MappingCallbacks callbacks,
                                 VoxelStore* store)
    : options_(options),
      serial_(std::make_unique<SerialMapping>(options_, std::move(callbacks), store)) {
  CheckOptions(options.preparation, "preparation");
  CheckOptions(options.pipeline, "pipeline");
}

MappingPipeline::~MappingPipeline() = default;

std::size_t MappingPipeline::Process(const ScanSource& source, const ScanRange& range,
                                     const std::atomic<bool>* stop) {
  ScanStages stages(source, range, stop, options_, serial_.get());
  RunPipeline(static_cast<std::size_t>(options_.pipeline.lookahead_scans), &stages);
  return stages.processed();
}

void MappingPipeline::Settle() { serial_->Settle(); }
void MappingPipeline::Finish() { serial_->Finish(); }
void MappingPipeline::StartLocalising(const SE3& T) { serial_->StartLocalising(T); }
const MappingCounts& MappingPipeline::counts() const { return serial_->counts(); }
void MappingPipeline::ShowOpenPoses(const FinalPoses::Visit& visit) const {
  serial_->ShowOpenPoses(visit);
}
std::vector<Eigen::Vector3d> MappingPipeline::NewestKeyframe() const {
  return serial_->NewestKeyframe();
}
const VoxelMap& MappingPipeline::map() const { return serial_->map(); }
VoxelMap& MappingPipeline::map() { return serial_->map(); }
void MappingPipeline::Archive(StateArchive& a) { a(serial_.get()); }

}  // namespace lamina
