#include "io/map/g2o_file.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "io/file/file_writer.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

constexpr std::size_t kPoseNumbers = 7, kInformationNumbers = 21;

struct Line {
  std::vector<std::int64_t> ids;
  std::vector<double> numbers;
};

// Of a line with a tag, `ids` ids and so many numbers.
Line Parse(const LineReader& lines, std::size_t ids, std::size_t numbers) {
  const std::vector<std::string_view> words = lines.Words();
  if (words.size() != 1 + ids + numbers) {
    lines.Fail(fmt::format("{} must be followed by {} numbers, found {}", words[0], ids + numbers,
                           words.size() - 1));
  }
  Line line;
  for (std::size_t i = 1; i < words.size(); ++i) {
    double value = 0.0;
    if (!ParseNumber(words[i], &value) || !std::isfinite(value)) {
      lines.Fail(fmt::format("'{}' is not a finite number", Printable(std::string(words[i]))));
    }
    if (i > ids) {
      line.numbers.push_back(value);
      continue;
    }
    constexpr double kMost = 9e15;
    if (value != std::floor(value) || std::abs(value) > kMost) {
      lines.Fail(fmt::format("'{}' is not an id, a whole number", words[i]));
    }
    line.ids.push_back(static_cast<std::int64_t>(value));
  }
  return line;
}

SE3 PoseOf(const LineReader& lines, const std::vector<double>& v) {
  const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  // Files of the field round to few digits.
  if (!(std::abs(q.norm() - 1.0) <= 1e-2)) {
    lines.Fail(fmt::format("the quaternion has norm {:.6g}, must be 1 within 1e-2", q.norm()));
  }
  return SE3(q, {v[0], v[1], v[2]});
}

// Halves exchanged: [a; b] to [b; a].
Matrix6d Exchanged(const Matrix6d& m) {
  Matrix6d exchanged;
  exchanged << m.bottomRightCorner<3, 3>(), m.bottomLeftCorner<3, 3>(), m.topRightCorner<3, 3>(),
      m.topLeftCorner<3, 3>();
  return exchanged;
}

// The information of [2 q; t] from that of [q; t] (factor 1/2), and back (2). Powers of two:
// nothing is rounded.
Matrix6d WithRotationScaled(Matrix6d m, double factor) {
  m.topRows<3>() *= factor;
  m.leftCols<3>() *= factor;
  return m;
}

Matrix6d InformationOf(const LineReader& lines, const std::vector<double>& v) {
  Matrix6d information;
  std::size_t next = kPoseNumbers;
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) information(i, j) = information(j, i) = v[next++];
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information, Eigen::EigenvaluesOnly);
  const double least = eigen.eigenvalues()(0), most = eigen.eigenvalues()(5);
  if (!(least >= -1e-9 * std::max(1e-300, most))) {
    lines.Fail(fmt::format(
        "the information must be positive semi-definite; its smallest eigenvalue is {:.6g}",
        least));
  }
  return WithRotationScaled(Exchanged(information), 0.5);
}

struct ReadEdge {
  std::int64_t from, to;
  G2oEdge edge;
  std::size_t line;
};

class Reader {
 public:
  explicit Reader(const std::string& path)
      : path_(path), text_(ReadFile(path)), lines_(path, text_) {}

  G2oGraph Read() {
    while (lines_.Next()) ReadLine(lines_.Words()[0]);
    if (vertices_.empty()) {
      throw InputError(path_ + ": has no vertex; a 3D pose graph in g2o form is needed");
    }
    G2oGraph graph;
    for (const auto& [id, pose] : vertices_) {
      graph.ids.push_back(id);
      graph.poses.push_back(pose);
    }
    for (ReadEdge& read : edges_) {
      read.edge.from = PositionOf(graph, read.from, read.line);
      read.edge.to = PositionOf(graph, read.to, read.line);
      graph.edges.push_back(read.edge);
    }
    for (const auto& [id, line] : fixed_) graph.fixed.push_back(PositionOf(graph, id, line));
    return graph;
  }

 private:
  void ReadLine(std::string_view tag) {
    if (tag == "VERTEX_SE3:QUAT") {
      const Line line = Parse(lines_, 1, kPoseNumbers);
      if (!vertices_.emplace(line.ids[0], PoseOf(lines_, line.numbers)).second)
        lines_.Fail(fmt::format("vertex {} is given twice", line.ids[0]));
    } else if (tag == "EDGE_SE3:QUAT") {
      const Line line = Parse(lines_, 2, kPoseNumbers + kInformationNumbers);
      if (line.ids[0] == line.ids[1])
        lines_.Fail(fmt::format("an edge joins vertex {} to itself", line.ids[0]));
      ReadEdge read{line.ids[0], line.ids[1], {}, lines_.number()};
      read.edge.T_from_to = PoseOf(lines_, line.numbers);
      read.edge.information = InformationOf(lines_, line.numbers);
      edges_.push_back(read);
    } else if (tag == "FIX") {
      for (const std::int64_t id : Parse(lines_, lines_.Words().size() - 1, 0).ids)
        fixed_.emplace_back(id, lines_.number());
    } else {
      lines_.Fail(
          fmt::format("'{}': only VERTEX_SE3:QUAT, EDGE_SE3:QUAT and FIX can be read, no 2D graphs "
                      "or landmarks",
                      Printable(std::string(tag))));
    }
  }

  std::size_t PositionOf(const G2oGraph& graph, std::int64_t id, std::size_t line) const {
    const auto found = std::lower_bound(graph.ids.begin(), graph.ids.end(), id);
    if (found == graph.ids.end() || *found != id)
      throw InputError(fmt::format("{}:{}: there is no vertex {}", path_, line, id));
    return static_cast<std::size_t>(found - graph.ids.begin());
  }

  std::string path_, text_;
  LineReader lines_;
  std::map<std::int64_t, SE3> vertices_;
  std::vector<ReadEdge> edges_;
  std::vector<std::pair<std::int64_t, std::size_t>> fixed_;
};

std::string PoseText(const SE3& T) {
  return fmt::format("{} {} {} {} {} {} {}", T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(), T.q.z(),
                     T.q.w());
}

}  // namespace

G2oGraph ReadG2o(const std::string& path) { return Reader(path).Read(); }

void WriteG2o(const std::string& path, const G2oGraph& graph) {
  FileWriter writer(path);
  for (std::size_t i = 0; i < graph.poses.size(); ++i)
    writer.Write(fmt::format("VERTEX_SE3:QUAT {} {}\n", graph.ids[i], PoseText(graph.poses[i])));
  for (const std::size_t i : graph.fixed) writer.Write(fmt::format("FIX {}\n", graph.ids[i]));
  for (const G2oEdge& edge : graph.edges) {
    std::string line = fmt::format("EDGE_SE3:QUAT {} {} {}", graph.ids[edge.from],
                                   graph.ids[edge.to], PoseText(edge.T_from_to));
    const Matrix6d information = Exchanged(WithRotationScaled(edge.information, 2.0));
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) line += fmt::format(" {}", information(i, j));
    }
    writer.Write(line + "\n");
  }
  writer.Commit();
}

}  // namespace lamina
