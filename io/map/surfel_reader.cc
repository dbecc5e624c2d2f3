#include "io/map/surfel_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <map>
#include <string_view>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr std::size_t kHeaderBytes = 65536;
constexpr std::size_t kBufferBytes = std::size_t{1} << 20;
constexpr std::string_view kEnd = "end_header\n";
constexpr std::array<std::string_view, 10> kNames = {"x",  "y",  "z",  "nx", "ny",
                                                     "nz", "l1", "l2", "l3", "count"};

// Bytes of a type of PLY; 0 for a word that is none.
std::size_t TypeBytes(std::string_view type) {
  static const std::map<std::string_view, std::size_t> kBytes = {
      {"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
      {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
      {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
  const auto found = kBytes.find(type);
  return found == kBytes.end() ? 0 : found->second;
}

}  // namespace

SurfelReader::SurfelReader(const std::string& path) : path_(path), file_(path) {
  buffer_.resize(std::min(file_.size(), kHeaderBytes));
  file_.Read(buffer_.data(), buffer_.size());
  bytes_left_ = file_.size() - buffer_.size();
  const std::size_t end = buffer_.find(kEnd);
  if (buffer_.compare(0, 4, "ply\n") != 0 || end == std::string::npos) {
    Fail("is no PLY file with a header of at most 64 kB");
  }
  at_ = end + kEnd.size();
  ReadHeader(buffer_.substr(0, at_));
  const std::size_t have = file_.size() - at_;
  if (count_ > have / record_bytes_) {
    Fail(fmt::format("{} surfels of {} bytes are announced, {} bytes follow", count_, record_bytes_,
                     have));
  }
}

void SurfelReader::ReadHeader(const std::string& text) {
  LineReader lines(path_, text);
  std::map<std::string_view, std::pair<std::size_t, std::string_view>> found;
  bool format = false, vertex = false;
  while (lines.Next()) {
    const auto words = lines.Words();
    if (words[0] == "format") {
      format = words.size() == 3 && words[1] == "binary_little_endian";
    } else if (words[0] == "element") {
      if (vertex || words.size() != 3 || words[1] != "vertex") {
        lines.Fail("a map of surfels has one element, vertex");
      }
      vertex = true;
      const auto [rest, error] =
          std::from_chars(words[2].data(), words[2].data() + words[2].size(), count_);
      if (error != std::errc() || rest != words[2].data() + words[2].size()) {
        lines.Fail("the count of surfels must be a whole number");
      }
    } else if (words[0] == "property") {
      const std::size_t bytes = words.size() == 3 ? TypeBytes(words[1]) : 0;
      if (bytes == 0) lines.Fail("a property has a type of fixed size and a name");
      found[words[2]] = {record_bytes_, words[1]};
      record_bytes_ += bytes;
    }
  }
  if (!format || !vertex) Fail("is no binary little-endian PLY file of surfels");
  for (std::size_t i = 0; i < kFields; ++i) {
    const std::string_view type = kNames[i] == "count" ? "uint" : "float";
    const auto property = found.find(kNames[i]);
    if (property == found.end() || property->second.second.substr(0, type.size()) != type) {
      Fail(fmt::format("is no map of surfels: it has no property {} of type {}", kNames[i], type));
    }
    offsets_[i] = property->second.first;
  }
}

bool SurfelReader::Next(Surfel* surfel) {
  if (next_ == count_) return false;
  if (buffer_.size() - at_ < record_bytes_) {
    buffer_.erase(0, at_);
    at_ = 0;
    const std::size_t had = buffer_.size();
    const std::size_t more = std::min(bytes_left_, std::max(kBufferBytes, record_bytes_));
    buffer_.resize(had + more);
    file_.Read(buffer_.data() + had, more);
    bytes_left_ -= more;
  }
  std::array<float, kFields - 1> values;
  for (std::size_t i = 0; i + 1 < kFields; ++i) {
    std::memcpy(&values[i], buffer_.data() + at_ + offsets_[i], sizeof(float));
  }
  const Eigen::Map<const Eigen::Matrix3f> columns(values.data());
  if (!columns.allFinite()) Fail(fmt::format("surfel {} is not finite", next_));
  surfel->centre = columns.col(0).cast<double>();
  surfel->normal = columns.col(1);
  surfel->eigenvalues = columns.col(2);
  std::memcpy(&surfel->count, buffer_.data() + at_ + offsets_[kFields - 1], sizeof(std::uint32_t));
  at_ += record_bytes_;
  ++next_;
  return true;
}

void SurfelReader::Fail(const std::string& what) const { throw InputError(path_ + ": " + what); }

}  // namespace lamina
