// A store of bytes in memory, which counts what is read and may be told to have lost it.
#pragma once

#include <atomic>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/byte_store.h"
#include "core/base/error.h"

namespace lamina {

class MemoryByteStore : public ByteStore {
 public:
  std::optional<StoredBytes> Append(std::string_view bytes) override {
    const StoredBytes place = {bytes_.size(), bytes.size(), 0};
    bytes_ += bytes;
    return place;
  }
  bool Read(const StoredBytes& place, char* to) const override {
    ++reads;
    if (damaged) return false;
    if (place.size > 0) std::memcpy(to, bytes_.data() + place.at, place.size);
    return true;
  }
  std::uint64_t size() const override { return bytes_.size(); }
  void RollBackTo(std::uint64_t size) override {
    if (size > bytes_.size()) throw InputError("a store has lost its end");
    bytes_.resize(size);
  }
  // Those that are to go are overwritten: who reads them all the same will see it.
  void KeepOnly(const std::vector<StoredBytes>& places) override {
    std::string kept(bytes_.size(), '\xff');
    for (const StoredBytes& place : places)
      kept.replace(place.at, place.size, bytes_, place.at, place.size);
    bytes_ = kept;
  }

  mutable std::atomic<int> reads{0};
  bool damaged = false;

 private:
  std::string bytes_;
};

}  // namespace lamina
