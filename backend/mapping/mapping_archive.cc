// The part of Mapping that is its state as bytes.
#include <memory>
#include <string>
#include <vector>

#include "backend/localisation/lost_searches.h"
#include "backend/localisation/piece_searches.h"
#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "backend/mapping/recording.h"

namespace lamina {

void Mapping::ArchiveRecording(StateArchive& a, Recording* recording) {
  bool maps = recording->mapper != nullptr, rests = recording->rests();
  a(&recording->any, &recording->last_stamp_ns, &recording->matched_stamp_ns,
    &recording->lost_stamp_ns, &recording->lost, &recording->last_sensor, &recording->not_after,
    &recording->not_after_ns, &recording->last_scan, &recording->over, &recording->piece,
    &recording->stream, &recording->certain, &recording->last, &maps, &rests);
  if (rests) return;
  if (a.reading() && maps) {
    MakeMapper(SE3(), recording);
  } else if (a.reading()) {
    recording->localiser = std::make_unique<Localiser>(options_.mapper, &map_, recording->piece);
  }
  if (maps) {
    a(recording->mapper.get());
  } else {
    a(recording->localiser.get());
  }
}

void Mapping::ArchiveSearches(StateArchive& a) {
  bool any = searches_ != nullptr;
  a(&any);
  if (!any) return;
  if (a.reading()) {
    searches_ = std::make_unique<PieceSearches>(options_.loops, options_.mapper.frontend.matcher,
                                                options_.mapper.map.LeafSize());
  }
  searches_->Archive(a, map_);
}

void Mapping::Archive(StateArchive& a) {
  bool localising = localise_from_.has_value();
  SE3 start = localise_from_.value_or(SE3());
  a(&counts_, &poses_, &localising, &start, &next_stream_, &newest_);
  ArchiveByKey(a, &stamps_, [this](const std::string& name) { return &stamps_[name]; });
  if (a.reading()) localise_from_ = localising ? std::make_optional(start) : std::nullopt;
  ArchiveSearches(a);
  std::vector<std::string> names;
  for (const auto& [name, recording] : *recordings_) names.push_back(name);
  a(&names);
  if (a.reading()) recordings_->clear();
  for (const std::string& name : names) ArchiveRecording(a, &(*recordings_)[name]);
  if (localise_from_ || searches_ != nullptr) EndLoops();
  if (loops_ == nullptr) return;
  lost_searches_->WaitForLooks();
  a(loops_.get(), lost_searches_.get());
}

}  // namespace lamina
