#include "io/packet/ip_fragments.h"

#include <algorithm>
#include <iterator>

namespace lamina {

std::list<IpFragments::Unfinished>::iterator IpFragments::Begin(const Fragment& fragment) {
  constexpr std::size_t kMostUnfinished = 64;
  if (unfinished_.size() >= kMostUnfinished) unfinished_.pop_front();
  Unfinished& unfinished = unfinished_.emplace_back();
  unfinished.key = fragment.key;
  unfinished.stamp_ns = fragment.stamp_ns;
  unfinished.place = fragment.place;
  return std::prev(unfinished_.end());
}

std::optional<IpFragments::Datagram> IpFragments::Add(const Fragment& fragment) {
  constexpr std::size_t kMostBytes = 65535;
  auto found = std::find_if(unfinished_.begin(), unfinished_.end(),
                            [&](const Unfinished& u) { return u.key == fragment.key; });
  if (found == unfinished_.end()) found = Begin(fragment);
  const std::size_t end = fragment.offset + fragment.data.size();
  const auto behind = found->parts.lower_bound(fragment.offset);
  const bool overlaps =
      (behind != found->parts.end() && behind->first < end) ||
      (behind != found->parts.begin() &&
       std::prev(behind)->first + std::prev(behind)->second.size() > fragment.offset);
  if (overlaps || (!fragment.more && found->bytes)) {
    unfinished_.erase(found);
    found = Begin(fragment);
  }
  if (fragment.data.empty() || end > kMostBytes) {
    unfinished_.erase(found);
    return std::nullopt;
  }
  found->parts.emplace(fragment.offset, fragment.data);
  found->received += fragment.data.size();
  if (!fragment.more) found->bytes = end;
  // Without overlaps as many bytes as it has are all of them, if none lies beyond its end.
  if (!found->bytes || found->received < *found->bytes) return std::nullopt;
  Datagram whole{"", found->stamp_ns, found->place};
  const bool beyond = found->parts.rbegin()->first >= *found->bytes;
  for (const auto& [offset, data] : found->parts) whole.data += data;
  unfinished_.erase(found);
  if (beyond) return std::nullopt;
  return whole;
}

}  // namespace lamina
