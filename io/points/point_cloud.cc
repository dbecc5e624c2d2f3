#include "io/points/point_cloud.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <initializer_list>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr std::array<std::uint64_t, 11> kBytesOf = {0, 1, 1, 2, 2, 4, 4, 4, 8, 8, 8};
constexpr std::uint32_t kFloat32 = 7, kFloat64 = 8;
constexpr std::size_t kLeftOut = SIZE_MAX;

std::string PlainName(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name.rfind("scalar_", 0) == 0 ? name.substr(7) : name;
}

template <typename T>
T ByteSwapped(T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  std::reverse(bytes, bytes + sizeof(T));
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

// A cloud and what goes on reading it.
class CloudReader {
 public:
  CloudReader(const PointCloudLayout& layout, std::string_view data, const std::string& name)
      : layout_(layout), data_(data), name_(name) {
    // A row may lack what pads it behind its last point. Nothing here can overflow: a factor
    // beyond the data is refused first.
    const auto too_few = [&](const char* what) {
      throw InputError(fmt::format(
          "{}: is damaged: {}: {} bytes for {} x {} points of {} bytes, rows of {} bytes", name_,
          what, data_.size(), layout_.width, layout_.height, layout_.point_step, layout_.row_step));
    };
    const std::uint64_t size = data_.size();
    if (layout.width == 0 || layout.height == 0) {
      throw InputError(fmt::format("{}: is empty: holds no points", name_));
    }
    if (layout.point_step == 0) too_few("points of no bytes");
    if (layout.width > size / layout.point_step) too_few("too few data");
    const std::uint64_t row = layout.width * layout.point_step;
    // Some drivers write nothing, or something else, for row_step.
    row_step_ = layout.row_step;
    if (row_step_ < row || (row_step_ > size / layout.height && row <= size / layout.height)) {
      row_step_ = row;
    }
    if (layout.height - 1 > (size - row) / row_step_) too_few("too few data");
  }

  std::size_t points() const { return static_cast<std::size_t>(layout_.width * layout_.height); }

  // The first of `names` that the cloud has; null if it has none.
  const PointCloudField* Find(std::initializer_list<const char*> names) const {
    for (const char* name : names) {
      for (const PointCloudField& field : layout_.fields) {
        if (PlainName(field.name) == name) return &field;
      }
    }
    return nullptr;
  }

  // Calls set(i, value) with the field's value of each point i.
  template <typename Set>
  void ForEachValue(const PointCloudField& field, const Set& set) const {
    Check(field);
    switch (field.datatype) {
      case 1:
        return ForEach<std::int8_t>(field, set);
      case 2:
        return ForEach<std::uint8_t>(field, set);
      case 3:
        return ForEach<std::int16_t>(field, set);
      case 4:
        return ForEach<std::uint16_t>(field, set);
      case 5:
        return ForEach<std::int32_t>(field, set);
      case 6:
        return ForEach<std::uint32_t>(field, set);
      case kFloat32:
        return ForEach<float>(field, set);
      case kFloat64:
        return ForEach<double>(field, set);
      case 9:
        return ForEach<std::int64_t>(field, set);
      default:
        return ForEach<std::uint64_t>(field, set);
    }
  }

 private:
  void Check(const PointCloudField& field) const {
    if (field.datatype == 0 || field.datatype >= kBytesOf.size()) {
      throw InputError(
          fmt::format("{}: field '{}' is of unknown type {}", name_, field.name, field.datatype));
    }
    const std::uint64_t bytes = kBytesOf[field.datatype];
    if (field.offset > layout_.point_step || bytes > layout_.point_step - field.offset) {
      throw InputError(fmt::format("{}: field '{}' at byte {} of points of {} bytes", name_,
                                   field.name, field.offset, layout_.point_step));
    }
  }

  template <typename T, typename Set>
  void ForEach(const PointCloudField& field, const Set& set) const {
    std::size_t i = 0;
    for (std::uint64_t row = 0; row < layout_.height; ++row) {
      const char* from = data_.data() + row * row_step_ + field.offset;
      for (std::uint64_t k = 0; k < layout_.width; ++k, from += layout_.point_step) {
        T value;
        std::memcpy(&value, from, sizeof(T));
        set(i++, layout_.big_endian ? ByteSwapped(value) : value);
      }
    }
  }

  const PointCloudLayout& layout_;
  const std::string_view data_;
  const std::string& name_;
  std::uint64_t row_step_ = 0;
};

// The points of the scan, and for each of the cloud its place among them (nothing if all are kept).
std::vector<std::size_t> TakePoints(const CloudReader& cloud, KeptPoints kept,
                                    const std::string& name, std::vector<ScanPoint>* points) {
  points->resize(cloud.points());
  const struct {
    const char* name;
    float ScanPoint::*member;
  } axes[] = {{"x", &ScanPoint::x}, {"y", &ScanPoint::y}, {"z", &ScanPoint::z}};
  for (const auto& axis : axes) {
    const PointCloudField* field = cloud.Find({axis.name});
    if (field == nullptr) throw InputError(fmt::format("{}: has no field '{}'", name, axis.name));
    if (field->datatype != kFloat32 && field->datatype != kFloat64) {
      throw InputError(fmt::format("{}: field '{}' must be float or double", name, axis.name));
    }
    cloud.ForEachValue(*field, [&](std::size_t i, auto value) {
      (*points)[i].*axis.member = static_cast<float>(value);
    });
  }
  const auto is_return = [](const ScanPoint& p) {
    return std::isfinite(p.x + p.y + p.z) && (p.x != 0.0F || p.y != 0.0F || p.z != 0.0F);
  };
  if (kept == KeptPoints::kAll || std::all_of(points->begin(), points->end(), is_return)) return {};
  std::vector<std::size_t> places(points->size(), kLeftOut);
  std::size_t count = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!is_return((*points)[i])) continue;
    (*points)[count] = (*points)[i];
    places[i] = count++;
  }
  points->resize(count);
  return places;
}

void TakeTimes(const CloudReader& cloud, const PointCloudField& field,
               const std::vector<std::size_t>& places, PointTimeUnit unit, const std::string& name,
               Scan* scan, PointTimeField* told) {
  std::vector<RawTime> raw(scan->points.size());
  cloud.ForEachValue(field, [&](std::size_t i, auto value) {
    const std::size_t at = places.empty() ? i : places[i];
    if (at == kLeftOut) return;
    raw[at] = static_cast<RawTime>(value);
    const ScanPoint& p = scan->points[at];
    if (!std::isfinite(raw[at]) && std::isfinite(p.x + p.y + p.z)) {
      throw InputError(
          fmt::format("{}: point {} has a place but no finite '{}'", name, i, field.name));
    }
  });
  PointTimes times = ConvertPointTimes(raw, field.datatype == kFloat32, unit,
                                       fmt::format("{}: field '{}'", name, field.name));
  if (told != nullptr) {
    *told = {field.name, times.unit, times.stamp_ns != 0, !times.time_s.empty()};
  }
  scan->stamp_ns = times.stamp_ns;
  scan->time_s = std::move(times.time_s);
}

}  // namespace

Scan ScanFromCloud(const PointCloudLayout& layout, std::string_view data, KeptPoints kept,
                   PointTimeUnit unit, const std::string& name, PointTimeField* times) {
  const CloudReader cloud(layout, data, name);
  Scan scan;
  const std::vector<std::size_t> places = TakePoints(cloud, kept, name, &scan.points);
  if (const auto* intensity = cloud.Find({"intensity", "reflectivity", "i"})) {
    cloud.ForEachValue(*intensity, [&](std::size_t i, auto value) {
      const std::size_t at = places.empty() ? i : places[i];
      if (at != kLeftOut) scan.points[at].intensity = static_cast<float>(value);
    });
  }
  const PointCloudField* time = cloud.Find({"t", "time", "timestamp", "time_stamp", "offset_time",
                                            "time_offset", "point_time_offset", "ts"});
  if (time != nullptr) TakeTimes(cloud, *time, places, unit, name, &scan, times);
  return scan;
}

}  // namespace lamina
