#include "io/file/text_input.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr std::string_view kBlanks = " \t\r";

// The digits of a decimal number and the power of ten of the last one.
struct Decimal {
  bool negative = false;
  std::string digits;
  long exponent = 0;
};

bool ParseDecimal(std::string_view word, Decimal* decimal) {
  std::size_t i = 0;
  if (i < word.size() && (word[i] == '-' || word[i] == '+')) decimal->negative = word[i++] == '-';
  bool point = false;
  for (; i < word.size() && (IsDigit(word[i]) || (word[i] == '.' && !point)); ++i) {
    if (word[i] == '.') {
      point = true;
    } else {
      decimal->digits += word[i];
      decimal->exponent -= point ? 1 : 0;
    }
  }
  if (decimal->digits.empty()) return false;
  if (i == word.size()) return true;
  if (word[i] != 'e' && word[i] != 'E') return false;
  const std::size_t sign = i + 1 < word.size() && word[i + 1] == '+' ? 1 : 0;
  const char* const end = word.data() + word.size();
  int exponent = 0;
  const auto result = std::from_chars(word.data() + i + 1 + sign, end, exponent);
  decimal->exponent += exponent;
  return result.ec == std::errc() && result.ptr == end && std::abs(exponent) < 1000;
}

}  // namespace

InputFile::InputFile(const std::string& path) : path_(path) {
  struct stat status;
  if (stat(path.c_str(), &status) != 0) {
    throw InputError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  }
  if (!S_ISREG(status.st_mode)) {
    throw InputError(fmt::format("{}: is not a regular file", path));
  }
  size_ = static_cast<std::size_t>(status.st_size);
  file_.reset(std::fopen(path.c_str(), "rb"));
  if (file_ == nullptr) {
    throw InputError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  }
}

void InputFile::Read(void* to, std::size_t bytes) {
  const std::size_t got = std::fread(to, 1, bytes, file_.get());
  if (got == bytes) return;
  throw InputError(fmt::format("{}: could be read up to byte {} only, {} expected: {}", path_, got,
                               bytes,
                               std::ferror(file_.get()) != 0 ? std::strerror(errno) : "it ends"));
}

std::string ReadFile(const std::string& path) {
  InputFile file(path);
  std::string bytes(file.size(), '\0');
  file.Read(bytes.data(), bytes.size());
  return bytes;
}

std::string ReadFileOrPipe(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             &std::fclose);
  std::string bytes;
  char some[1 << 16];
  std::size_t got = 0;
  while (file != nullptr && (got = std::fread(some, 1, sizeof(some), file.get())) > 0) {
    bytes.append(some, got);
  }
  if (file == nullptr || std::ferror(file.get()) != 0) {
    throw InputError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  }
  return bytes;
}

bool LineReader::Next() {
  while (next_ < text_.size()) {
    const std::size_t end = std::min(text_.find('\n', next_), text_.size());
    line_ = text_.substr(next_, end - next_);
    next_ = std::min(end + 1, text_.size());
    ++number_;
    const std::size_t first = line_.find_first_not_of(kBlanks);
    if (first == std::string_view::npos || line_[first] == '#') continue;
    line_ = line_.substr(first, line_.find_last_not_of(kBlanks) + 1 - first);
    return true;
  }
  return false;
}

std::vector<std::string_view> LineReader::Words() const {
  std::vector<std::string_view> words;
  for (std::size_t begin = 0; begin < line_.size();) {
    const std::size_t end = std::min(line_.find_first_of(kBlanks, begin), line_.size());
    words.push_back(line_.substr(begin, end - begin));
    begin = std::min(line_.find_first_not_of(kBlanks, end), line_.size());
  }
  return words;
}

void LineReader::Numbers(std::vector<double>* numbers) const {
  numbers->clear();
  for (const std::string_view word : Words()) {
    if (!ParseNumber(word, &numbers->emplace_back())) {
      Fail(fmt::format("'{}' is not a number", word.substr(0, 40)));
    }
  }
}

void LineReader::Fail(const std::string& what) const {
  throw InputError(fmt::format("{}:{}: {}", path_, number_, what));
}

bool ParseNumber(std::string_view word, double* value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  const char* const end = word.data() + word.size();
  const auto [ptr, error] = std::from_chars(word.data(), end, *value);
  if (ptr != end || error == std::errc::invalid_argument) return false;
  // Too small or too large for a double: 0 or infinity, as strtod has it.
  if (error != std::errc()) *value = std::strtod(std::string(word).c_str(), nullptr);
  return true;
}

bool ParseSecondsNs(std::string_view word, StampNs* stamp_ns) {
  Decimal decimal;
  if (!ParseDecimal(word, &decimal)) return false;
  std::string& digits = decimal.digits;
  digits.erase(0, digits.find_first_not_of('0'));
  // How many of the digits stand at or before the place of the nanosecond.
  const long whole = static_cast<long>(digits.size()) + decimal.exponent + 9;
  *stamp_ns = 0;
  if (digits.empty() || whole < 0) return true;
  if (whole > 19) return false;
  const std::size_t kept = static_cast<std::size_t>(whole);
  const bool round_up = kept < digits.size() && digits[kept] >= '5';
  digits.resize(kept, '0');
  std::uint64_t ns = 0;
  for (const char c : digits) ns = 10 * ns + static_cast<std::uint64_t>(c - '0');
  ns += round_up ? 1 : 0;
  if (ns > static_cast<std::uint64_t>(std::numeric_limits<StampNs>::max())) return false;
  *stamp_ns = decimal.negative ? -static_cast<StampNs>(ns) : static_cast<StampNs>(ns);
  return true;
}

bool RepairRotation(Eigen::Matrix3d* R) {
  const Eigen::Matrix3d error = R->transpose() * *R - Eigen::Matrix3d::Identity();
  // Written so that NaN breaks the rule.
  if (!(error.cwiseAbs().maxCoeff() <= 1e-3) || !(R->determinant() > 0.0)) return false;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(*R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  *R = svd.matrixU() * svd.matrixV().transpose();
  return true;
}

SE3 PoseFromRowMajor(const std::vector<double>& numbers, const LineReader& lines) {
  if (numbers.size() != 12) {
    lines.Fail(fmt::format("a pose has 12 numbers (row-major [R | t]), found {}", numbers.size()));
  }
  if (!std::all_of(numbers.begin(), numbers.end(), [](double v) { return std::isfinite(v); })) {
    lines.Fail("the numbers of a pose must be finite");
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> pose(numbers.data());
  Eigen::Matrix3d R = pose.leftCols<3>();
  if (!RepairRotation(&R)) {
    lines.Fail("the left 3x3 block must be a rotation (R'R = I within 1e-3, determinant +1)");
  }
  return SE3(R, pose.col(3));
}

}  // namespace lamina
