// The state of an object as bytes, written and read by ONE function.
//
//     void Odometry::Archive(StateArchive& a) { a(&started_, &last_stamp_ns_, &T_world_last_); }
//
// With a writing archive each call appends the values, with a reading one it sets them, so what is
// read back can never differ from what was written. Numbers are little-endian, as they lie in
// memory (doubles keep every bit); a vector is its length (u64) and its elements. Nothing in the
// bytes tells types: who reads must know the version (backend/session/checkpoint.h).
//
// A class of its own takes part by a member `void Archive(StateArchive&)`; the structs of core by
// the functions at the end of this file.
//
// Not thread-safe. Reading throws InputError if the bytes end too early.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <deque>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"

namespace lamina {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "archives are little-endian");

// Types without padding and pointers, whose bytes in memory are their state.
template <typename T>
inline constexpr bool kPlainState = std::is_arithmetic_v<T>;
template <>
inline constexpr bool kPlainState<PointCluster> = true;
static_assert(sizeof(PointCluster) == 10 * sizeof(double));
template <>
inline constexpr bool kPlainState<TimedCluster> = true;
static_assert(sizeof(TimedCluster) == 15 * sizeof(double));

class StateArchive {
 public:
  // Writes.
  StateArchive() = default;
  // Reads; `bytes` must outlive the archive.
  explicit StateArchive(std::string_view bytes) : reading_(true), in_(bytes) {}

  bool reading() const { return reading_; }
  std::string& written() { return out_; }
  std::size_t unread() const { return in_.size(); }

  void Bytes(void* data, std::size_t size) {
    if (!reading_) {
      out_.append(static_cast<const char*>(data), size);
      return;
    }
    if (size > in_.size()) throw InputError("saved state ends too early");
    if (size > 0) std::memcpy(data, in_.data(), size);
    in_.remove_prefix(size);
  }

  template <typename... T>
  void operator()(T*... values) {
    (Value(values), ...);
  }

  // The length of a container. When reading, at least `min_bytes` must follow for each element:
  // damaged bytes must not make anyone allocate without bounds.
  std::size_t Size(std::size_t size, std::size_t min_bytes) {
    std::uint64_t count = size;
    Value(&count);
    if (reading_ && count > in_.size() / std::max<std::size_t>(1, min_bytes)) {
      throw InputError("saved state ends too early");
    }
    return static_cast<std::size_t>(count);
  }

 private:
  template <typename T>
  std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>> Value(T* value) {
    Bytes(value, sizeof(T));
  }
  template <typename T, int Rows, int Cols>
  void Value(Eigen::Matrix<T, Rows, Cols>* m) {
    static_assert(Rows > 0 && Cols > 0, "of fixed size");
    Bytes(m->data(), sizeof(T) * static_cast<std::size_t>(Rows * Cols));
  }
  void Value(std::string* text) {
    text->resize(Size(text->size(), 1));
    Bytes(text->data(), text->size());
  }
  template <typename T>
  void Value(std::vector<T>* values) {
    if constexpr (kPlainState<T>) {
      values->resize(Size(values->size(), sizeof(T)));
      Bytes(values->data(), sizeof(T) * values->size());
    } else {
      values->resize(Size(values->size(), 1));
      for (T& value : *values) Value(&value);
    }
  }
  template <typename T>
  void Value(std::deque<T>* values) {
    values->resize(Size(values->size(), 1));
    for (T& value : *values) Value(&value);
  }
  template <typename T>
  std::enable_if_t<std::is_class_v<T>> Value(T* value) {
    if constexpr (kPlainState<T>) {
      Bytes(value, sizeof(T));
    } else {
      Archive(*this, value);
    }
  }

  bool reading_ = false;
  std::string_view in_;
  std::string out_;
};

inline void Archive(StateArchive& a, SE3* T) {
  Eigen::Vector4d q = T->q.coeffs();
  a(&q, &T->t);
  // Only then: what is written may be read by other threads. Not by a constructor, which would
  // normalise again.
  if (a.reading()) T->q.coeffs() = q;
}
inline void Archive(StateArchive& a, StampedPose* p) { a(&p->stamp_ns, &p->T_world_lidar); }

// A map: its keys, then its values, each where value_of(key) is, which makes one to be read into.
template <typename Map, typename ValueOf>
void ArchiveByKey(StateArchive& a, Map* map, const ValueOf& value_of) {
  std::vector<typename Map::key_type> keys;
  for (const auto& entry : *map) keys.push_back(entry.first);
  a(&keys);
  if (a.reading()) map->clear();
  for (const auto& key : keys) a(value_of(key));
}

// A class with a member Archive().
template <typename T>
auto Archive(StateArchive& a, T* value) -> decltype(value->Archive(a)) {
  value->Archive(a);
}

}  // namespace lamina
