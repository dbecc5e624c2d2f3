#include "tools/watch/continued.h"

#include <optional>
#include <utility>

#include "core/base/error.h"
#include "io/recording/recording_file.h"

namespace lamina {
namespace {

// The scans of a recording that has gone.
class MissingRecording final : public ScanSource {
 public:
  explicit MissingRecording(std::string reason) : reason_(std::move(reason)) {}
  std::size_t size() const override { return 0; }
  std::string Name(std::size_t) const override { return reason_; }
  StampNs Stamp(std::size_t) const override { return 0; }
  Scan Read(std::size_t) const override { throw InputError(reason_); }

 private:
  const std::string reason_;
};

}  // namespace

std::size_t ContinueInbox(const SessionDatabase& database, Inbox* inbox) {
  // Recordings of which nothing is left stand among the files set aside.
  std::int64_t ended = 0;
  for (const SessionDatabase::Sequence& sequence : database.Sequences(database.scans())) {
    const ScanRecord& last = sequence.last;
    const auto number = ScanNumber(last.sequence, last.file);
    if (number && database.Knows(last.sequence)) ++ended;
    inbox->Continue({last.sequence, number ? *number + 1 : static_cast<std::size_t>(sequence.scans),
                     last.file, last.stamp_ns, last.recorded_stamp});
  }
  return static_cast<std::size_t>(database.set_aside() - ended);
}

std::unique_ptr<StreamedScans> ContinueScans(const SessionDatabase& database, std::int64_t next,
                                             const ScanSourceOptions& options) {
  auto scans = std::make_unique<StreamedScans>(static_cast<std::size_t>(next), options);
  for (const SessionDatabase::Sequence& sequence : database.Sequences(next)) {
    for (const ScanRecord& row :
         database.LastOf(sequence.last.sequence, next, static_cast<int>(StreamedScans::kHistory))) {
      scans->AppendPast(row.sequence, static_cast<std::size_t>(row.scan), row.stamp_ns);
    }
  }
  return scans;
}

bool RepeatedFiles::Ready(const ScanRecord& row) {
  if (!ScanNumber(row.sequence, row.file)) return true;
  if (opener_.busy() && opener_.done()) Take();
  if (opened_name_ == row.sequence && opened_ != nullptr) return true;
  if (opener_.busy()) return false;
  opened_name_ = row.sequence;
  opened_ = nullptr;
  opener_.Begin(files_.Find(row.sequence), options_);
  return false;
}

void RepeatedFiles::Take() {
  RecordingOpener::Opened opened = opener_.Take();
  opened_ = std::move(opened.scans);
  if (opened_ == nullptr) opened_ = std::make_shared<MissingRecording>(opened.error);
}

InboxFile RepeatedFiles::FileOf(const ScanRecord& row) {
  const std::optional<std::size_t> number = ScanNumber(row.sequence, row.file);
  InboxFile file{row.file,           files_.Find(number ? row.sequence : row.file),
                 row.sequence,       row.stamp_ns,
                 row.recorded_stamp, row.next_stamp_ns};
  if (!number) return file;
  if (!Ready(row)) Take();
  file.recording = opened_;
  file.scan_in_recording = *number;
  return file;
}

}  // namespace lamina
