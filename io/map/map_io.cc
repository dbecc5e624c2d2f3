#include "io/map/map_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/file/folder_list.h"
#include "io/las/copc_file.h"
#include "io/las/las_file.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              "records are written as they lie in memory, and the formats want little-endian");

constexpr double kRedThicknessM = 0.05;

struct Colour {
  std::uint8_t red, green, blue;
};

// t = 0 blue, 1/2 green, 1 red.
Colour ThicknessColour(double thickness_m) {
  const double t = std::min(thickness_m / kRedThicknessM, 1.0);
  const double red = std::max(0.0, 2.0 * t - 1.0);
  const double blue = std::max(0.0, 1.0 - 2.0 * t);
  const auto byte = [](double share) { return static_cast<std::uint8_t>(255.0 * share + 0.5); };
  return {byte(red), byte(1.0 - red - blue), byte(blue)};
}

template <typename T>
void AppendBytes(const T& value, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

// A field of a record; the type as PLY calls it and as PCD does.
struct Field {
  std::string_view name, ply_type;
  char pcd_type;
  int pcd_size;
};
constexpr Field Float(std::string_view name) { return {name, "float", 'F', 4}; }

using Fields = std::vector<Field>;

std::string PlyHeader(const Fields& fields, std::size_t count) {
  std::string header = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment Lamina\nelement vertex {}\n", count);
  for (const Field& f : fields) header += fmt::format("property {} {}\n", f.ply_type, f.name);
  return header + "end_header\n";
}

std::string PcdHeader(const Fields& fields, std::size_t count) {
  std::string names, sizes, types, counts;
  for (const Field& f : fields) {
    names += fmt::format(" {}", f.name);
    sizes += fmt::format(" {}", f.pcd_size);
    types += fmt::format(" {}", f.pcd_type);
    counts += " 1";
  }
  return fmt::format(
      "# .PCD v0.7 - Lamina\nVERSION 0.7\nFIELDS{}\nSIZE{}\nTYPE{}\nCOUNT{}\nWIDTH {}\nHEIGHT 1\n"
      "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary\n",
      names, sizes, types, counts, count, count);
}

// What PLY and PCD files of surfels have in common; the normal's and colour's names differ.
Fields SurfelFields(const std::array<std::string_view, 3>& normal, const Fields& colour) {
  Fields fields = {Float("x"),
                   Float("y"),
                   Float("z"),
                   Float(normal[0]),
                   Float(normal[1]),
                   Float(normal[2]),
                   Float("l1"),
                   Float("l2"),
                   Float("l3"),
                   Float("thickness_m"),
                   {"count", "uint", 'U', 4}};
  fields.insert(fields.end(), colour.begin(), colour.end());
  return fields;
}

// A file of equal records whose header tells their number, which is known at the end alone.
class RecordFile {
 public:
  RecordFile(const std::string& path, Fields ply_fields, Fields pcd_fields)
      : ply_(IsPly(path)), fields_(std::move(ply_ ? ply_fields : pcd_fields)), writer_(path) {
    writer_.Write(Header());
  }

  bool ply() const { return ply_; }
  std::size_t count() const { return count_; }

  void Append(std::string_view bytes, std::size_t records) {
    writer_.Write(bytes);
    count_ += records;
  }

  void Commit() {
    writer_.Overwrite(0, Header());
    writer_.Commit();
  }

 private:
  static bool IsPly(const std::string& path) {
    const std::string ending = LowerEnding(path);
    if (ending == ".ply" || ending == ".pcd") return ending == ".ply";
    throw OptionError(fmt::format("{}: the name must end in .ply or .pcd", path));
  }

  // The header for any count has the same length: a comment makes up for missing digits. (Leading
  // zeros would do, too, but some readers take them for octal.)
  std::string Header() const {
    const auto make = ply_ ? PlyHeader : PcdHeader;
    const std::size_t missing = make(fields_, std::numeric_limits<std::size_t>::max()).size() -
                                make(fields_, count_).size();
    std::string header = make(fields_, count_);
    const std::string_view mark = ply_ ? "comment Lamina" : "- Lamina";
    return header.insert(header.find(mark) + mark.size(), missing, '.');
  }

  bool ply_;
  Fields fields_;
  FileWriter writer_;
  std::size_t count_ = 0;
};

Fields PlySurfelFields() {
  return SurfelFields(
      {"nx", "ny", "nz"},
      {{"red", "uchar", 'U', 1}, {"green", "uchar", 'U', 1}, {"blue", "uchar", 'U', 1}});
}

Fields PcdSurfelFields() {
  return SurfelFields({"normal_x", "normal_y", "normal_z"}, {{"rgb", "uint", 'U', 4}});
}

Fields CloudFields() { return {Float("x"), Float("y"), Float("z"), Float("intensity")}; }

}  // namespace

struct SurfelWriter::Impl {
  RecordFile file;
  std::string record;
};

SurfelWriter::SurfelWriter(const std::string& path)
    : impl_(new Impl{{path, PlySurfelFields(), PcdSurfelFields()}, ""}) {}

SurfelWriter::~SurfelWriter() = default;

void SurfelWriter::Append(const Surfel& s) {
  std::string& record = impl_->record;
  record.clear();
  // Rounding may leave the eigenvalue of a perfect plane below zero.
  const float thickness_m = std::sqrt(std::max(0.0F, s.eigenvalues[2]));
  const Eigen::Vector3f centre = s.centre.cast<float>();
  for (const Eigen::Vector3f& v : {centre, s.normal, s.eigenvalues}) {
    for (int i = 0; i < 3; ++i) AppendBytes(v[i], &record);
  }
  AppendBytes(thickness_m, &record);
  AppendBytes(s.count, &record);
  const Colour c = ThicknessColour(thickness_m);
  if (impl_->file.ply()) {
    AppendBytes(c, &record);
  } else {
    AppendBytes(std::array<std::uint8_t, 4>{c.blue, c.green, c.red, 0}, &record);
  }
  impl_->file.Append(record, 1);
}

void SurfelWriter::Commit() { impl_->file.Commit(); }

std::size_t SurfelWriter::size() const { return impl_->file.count(); }

void WriteSurfels(const std::string& path, const SurfelMap& surfels) {
  SurfelWriter writer(path);
  for (const Surfel& surfel : surfels) writer.Append(surfel);
  writer.Commit();
}

namespace {

// What clouds are written to.
class CloudFile {
 public:
  virtual ~CloudFile() = default;
  virtual void Append(const std::vector<CloudPoint>& points) = 0;
  virtual void Commit() = 0;
  virtual std::size_t count() const = 0;
};

class PlyOrPcdCloud final : public CloudFile {
 public:
  explicit PlyOrPcdCloud(const std::string& path) : file_(path, CloudFields(), CloudFields()) {}
  void Append(const std::vector<CloudPoint>& points) override {
    std::string bytes;
    bytes.reserve(points.size() * sizeof(ScanPoint));
    for (const CloudPoint& point : points) {
      const Eigen::Vector3f f = point.p.cast<float>();
      AppendBytes(ScanPoint{f.x(), f.y(), f.z(), point.intensity}, &bytes);
    }
    file_.Append(bytes, points.size());
  }
  void Commit() override { file_.Commit(); }
  std::size_t count() const override { return file_.count(); }

 private:
  RecordFile file_;
};

// Of LasFile or CopcFile.
template <typename File>
class LasCloud final : public CloudFile {
 public:
  template <typename... Arguments>
  explicit LasCloud(const Arguments&... arguments) : file_(arguments...) {}
  void Append(const std::vector<CloudPoint>& points) override { file_.Append(points); }
  void Commit() override { file_.Commit(); }
  std::size_t count() const override { return file_.count(); }

 private:
  File file_;
};

std::unique_ptr<CloudFile> OpenCloud(const std::string& path) {
  const std::string ending = LowerEnding(path);
  if (ending == ".laz" && LowerEnding(std::filesystem::path(path).stem().string()) == ".copc")
    return std::make_unique<LasCloud<CopcFile>>(path);
  if (ending == ".laz") return std::make_unique<LasCloud<LasFile>>(path, true);
  if (ending == ".las") return std::make_unique<LasCloud<LasFile>>(path, false);
  if (ending == ".ply" || ending == ".pcd") return std::make_unique<PlyOrPcdCloud>(path);
  throw OptionError(
      fmt::format("{}: the name must end in .ply, .pcd, .las, .laz or .copc.laz", path));
}

}  // namespace

struct CloudWriter::Impl {
  std::unique_ptr<CloudFile> file;
};

CloudWriter::CloudWriter(const std::string& path) : impl_(new Impl{OpenCloud(path)}) {}

CloudWriter::~CloudWriter() = default;

void CloudWriter::Append(const std::vector<CloudPoint>& points) { impl_->file->Append(points); }

void CloudWriter::Append(const std::vector<ScanPoint>& points) {
  std::vector<CloudPoint> cloud;
  cloud.reserve(points.size());
  for (const ScanPoint& p : points) cloud.push_back({{p.x, p.y, p.z}, p.intensity, 0.0});
  Append(cloud);
}

void CloudWriter::Commit() { impl_->file->Commit(); }

std::size_t CloudWriter::size() const { return impl_->file->count(); }

}  // namespace lamina
