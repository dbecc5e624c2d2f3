#include "io/points/point_cloud.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <type_traits>
#include <utility>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

constexpr std::array<std::uint64_t, 11> kBytesOf = {0, 1, 1, 2, 2, 4, 4, 4, 8, 8, 8};
constexpr std::uint32_t kFloat32 = 7, kFloat64 = 8;

// The cells of a cloud whose points are kept: all, or those at these bytes of its data.
struct KeptCells {
  bool all = true;
  std::vector<std::size_t> at;
};

bool IsReturn(const ScanPoint& p) {
  return std::isfinite(p.x + p.y + p.z) & ((p.x != 0.0F) | (p.y != 0.0F) | (p.z != 0.0F));
}

std::string PlainName(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name.rfind("scalar_", 0) == 0 ? name.substr(7) : name;
}

// Axes of a cloud, and its intensity if it has one.
struct PointFields {
  std::array<const PointCloudField*, 3> axes{};
  const PointCloudField* intensity = nullptr;
};

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

  const std::string& name() const { return name_; }
  // Of points, which may hold no return.
  std::size_t cells() const { return static_cast<std::size_t>(layout_.width * layout_.height); }

  // The first of `names` that the cloud has; null if it has none.
  const PointCloudField* Find(std::initializer_list<const char*> names) const {
    for (const char* name : names) {
      for (const PointCloudField& field : layout_.fields) {
        if (PlainName(field.name) == name) return &field;
      }
    }
    return nullptr;
  }

  // Hands use() the field's values in these cells, as a vector of float, double, std::uint32_t,
  // std::int64_t or std::uint64_t: of the one that holds all values of the field's type.
  template <typename Use>
  void UseColumn(const PointCloudField& field, const KeptCells& cells, const Use& use) const {
    Check(field);
    switch (field.datatype) {
      case 1:
        return use(Column<std::int8_t, std::int64_t>(field, cells));
      case 2:
        return use(Column<std::uint8_t, std::uint32_t>(field, cells));
      case 3:
        return use(Column<std::int16_t, std::int64_t>(field, cells));
      case 4:
        return use(Column<std::uint16_t, std::uint32_t>(field, cells));
      case 5:
        return use(Column<std::int32_t, std::int64_t>(field, cells));
      case 6:
        return use(Column<std::uint32_t, std::uint32_t>(field, cells));
      case kFloat32:
        return use(Column<float, float>(field, cells));
      case kFloat64:
        return use(Column<double, double>(field, cells));
      case 9:
        return use(Column<std::int64_t, std::int64_t>(field, cells));
      default:
        return use(Column<std::uint64_t, std::uint64_t>(field, cells));
    }
  }

  // The points that are kept, and of which cells they are.
  KeptCells TakePoints(const PointFields& fields, KeptPoints kept,
                       std::vector<ScanPoint>* points) const {
    for (const PointCloudField* axis : fields.axes) Check(*axis);
    points->resize(cells());
    // Of most clouds all are float32 in the order of bytes of this machine: one pass takes them.
    const auto is_plain = [this](const PointCloudField* field) {
      return field->datatype == kFloat32 && !layout_.big_endian;
    };
    const bool plain_axes = std::all_of(fields.axes.begin(), fields.axes.end(), is_plain);
    const PointCloudField* intensity = fields.intensity;
    if (intensity != nullptr) Check(*intensity);
    if (plain_axes && intensity != nullptr && is_plain(intensity)) {
      TakeFloats<true>(fields, points);
      intensity = nullptr;
    } else if (plain_axes) {
      TakeFloats<false>(fields, points);
    } else {
      TakeColumn(*fields.axes[0], {}, &ScanPoint::x, points);
      TakeColumn(*fields.axes[1], {}, &ScanPoint::y, points);
      TakeColumn(*fields.axes[2], {}, &ScanPoint::z, points);
    }
    KeptCells cells = kept == KeptPoints::kAll ? KeptCells() : KeepReturns(points);
    if (intensity != nullptr) TakeColumn(*intensity, cells, &ScanPoint::intensity, points);
    return cells;
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

  template <bool kIntensity>
  void TakeFloats(const PointFields& fields, std::vector<ScanPoint>* points) const {
    const std::size_t x = fields.axes[0]->offset, y = fields.axes[1]->offset,
                      z = fields.axes[2]->offset;
    const std::size_t intensity = kIntensity ? fields.intensity->offset : 0;
    ForEachCell([&, to = points->data()](const char* from) mutable {
      *to++ = {LoadNumber<float>(from + x), LoadNumber<float>(from + y),
               LoadNumber<float>(from + z),
               kIntensity ? LoadNumber<float>(from + intensity) : 0.0F};
    });
  }

  void TakeColumn(const PointCloudField& field, const KeptCells& cells, float ScanPoint::*member,
                  std::vector<ScanPoint>* points) const {
    UseColumn(field, cells, [&](const auto& column) {
      for (std::size_t i = 0; i < column.size(); ++i) {
        (*points)[i].*member = static_cast<float>(column[i]);
      }
    });
  }

  // Leaves those out that are no returns.
  KeptCells KeepReturns(std::vector<ScanPoint>* points) const {
    // Without a branch a point: of most clouds they all are.
    bool all = true;
    for (const ScanPoint& p : *points) all &= IsReturn(p);
    if (all) return {};
    KeptCells kept;
    kept.all = false;
    kept.at.reserve(points->size());
    std::size_t i = 0;
    ForEachCell([&](const char* cell) {
      const ScanPoint point = (*points)[i++];
      if (!IsReturn(point)) return;
      (*points)[kept.at.size()] = point;
      kept.at.push_back(static_cast<std::size_t>(cell - data_.data()));
    });
    points->resize(kept.at.size());
    return kept;
  }

  // Calls use() with the first byte of each.
  template <typename Use>
  void ForEachCell(Use use) const {
    for (std::uint64_t row = 0; row < layout_.height; ++row) {
      const char* from = data_.data() + row * row_step_;
      for (std::uint64_t k = 0; k < layout_.width; ++k) use(from + k * layout_.point_step);
    }
  }

  template <typename T, typename Wide>
  std::vector<Wide> Column(const PointCloudField& field, const KeptCells& cells) const {
    return layout_.big_endian ? Gathered<T, true, Wide>(field.offset, cells)
                              : Gathered<T, false, Wide>(field.offset, cells);
  }

  template <typename T, bool kSwapped, typename Wide>
  std::vector<Wide> Gathered(std::size_t offset, const KeptCells& kept) const {
    std::vector<Wide> column(kept.all ? cells() : kept.at.size());
    Wide* to = column.data();
    const auto take = [&](const char* cell) {
      *to++ = static_cast<Wide>(LoadNumber<T>(cell + offset, kSwapped));
    };
    if (kept.all) {
      ForEachCell(take);
    } else {
      for (const std::size_t at : kept.at) take(data_.data() + at);
    }
    return column;
  }

  const PointCloudLayout& layout_;
  const std::string_view data_;
  const std::string& name_;
  std::uint64_t row_step_ = 0;
};

std::array<const PointCloudField*, 3> FindAxes(const CloudReader& cloud, const std::string& name) {
  std::array<const PointCloudField*, 3> axes{};
  constexpr std::array<const char*, 3> kNames = {"x", "y", "z"};
  for (std::size_t a = 0; a < axes.size(); ++a) {
    axes[a] = cloud.Find({kNames[a]});
    if (axes[a] == nullptr) {
      throw InputError(fmt::format("{}: has no field '{}'", name, kNames[a]));
    }
    if (axes[a]->datatype != kFloat32 && axes[a]->datatype != kFloat64) {
      throw InputError(fmt::format("{}: field '{}' must be float or double", name, kNames[a]));
    }
  }
  return axes;
}

// What a driver writes as the time of a pulse without a return is none: zero, often, beside times
// since an epoch. Those cells get none.
template <typename T>
PointTimes ReadTimes(const std::vector<T>& column, const std::vector<ScanPoint>& points,
                     PointTimeUnit unit, const std::string& field) {
  if (std::all_of(points.begin(), points.end(), IsReturn))
    return ConvertPointTimes(column, unit, field);
  std::vector<T> of_returns;
  for (std::size_t i = 0; i < column.size(); ++i) {
    if (IsReturn(points[i])) of_returns.push_back(column[i]);
  }
  PointTimes times = ConvertPointTimes(of_returns, unit, field);
  if (times.time_s.empty()) return times;
  std::vector<float> of_all(column.size(), std::numeric_limits<float>::quiet_NaN());
  std::size_t next = 0;
  for (std::size_t i = 0; i < column.size(); ++i) {
    if (IsReturn(points[i])) of_all[i] = times.time_s[next++];
  }
  times.time_s = std::move(of_all);
  return times;
}

}  // namespace

Scan ScanFromCloud(const PointCloudLayout& layout, std::string_view data, KeptPoints kept,
                   PointTimeUnit unit, const std::string& name, PointTimeField* times) {
  const CloudReader cloud(layout, data, name);
  Scan scan;
  const PointFields fields = {FindAxes(cloud, name),
                              cloud.Find({"intensity", "reflectivity", "i"})};
  const KeptCells cells = cloud.TakePoints(fields, kept, &scan.points);
  const PointCloudField* time =
      cloud.Find({"t", "time", "timestamp", "time_stamp", "offset_time", "time_offset",
                  "point_time_offset", "ts", "gps_time", "gpstime"});
  if (time == nullptr) return scan;
  cloud.UseColumn(*time, cells, [&](const auto& column) {
    PointTimes read =
        ReadTimes(column, scan.points, unit, fmt::format("{}: field '{}'", name, time->name));
    if (times != nullptr) {
      *times = {time->name, read.unit, read.stamp_ns != 0, !read.time_s.empty()};
    }
    scan.stamp_ns = read.stamp_ns;
    scan.time_s = std::move(read.time_s);
  });
  return scan;
}

}  // namespace lamina
