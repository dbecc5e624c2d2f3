// Reading files of bytes, lines and numbers, with errors that name file and line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"

namespace lamina {

// A regular file, open for reading. Throws InputError naming the path and the system's reason.
// Anything but a regular file is refused before it is opened: opening a pipe could wait for ever.
class InputFile {
 public:
  explicit InputFile(const std::string& path);
  std::size_t size() const { return size_; }
  // Fills `to` with the next bytes; throws InputError if the file ends before.
  void Read(void* to, std::size_t bytes);

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_;
  std::size_t size_ = 0;
  std::unique_ptr<std::FILE, Close> file_;
};

// The whole file.
std::string ReadFile(const std::string& path);
// The same of what was named by hand, which may be the end of a pipe as well.
std::string ReadFileOrPipe(const std::string& path);

// Walks over the lines of a text that mean something: blank lines and lines that start with # are
// passed over, blanks at both ends (so the CR of CRLF, too) are cut off. `text` must outlive it.
class LineReader {
 public:
  LineReader(std::string path, std::string_view text) : path_(std::move(path)), text_(text) {}

  // Goes to the next line; false at the end of the text.
  bool Next();
  std::string_view line() const { return line_; }
  // Number of the line, from 1, and offset in the text of the line behind it.
  std::size_t number() const { return number_; }
  std::size_t next_offset() const { return next_; }
  // The line's words, parted by blanks.
  std::vector<std::string_view> Words() const;
  // The line as numbers (nan and inf are numbers); throws InputError at a word that is none.
  void Numbers(std::vector<double>* numbers) const;

  // Throws InputError "path:line: what".
  [[noreturn]] void Fail(const std::string& what) const;

 private:
  std::string path_;
  std::string_view text_, line_;
  std::size_t number_ = 0, next_ = 0;
};

inline bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// One number, written as C does, whatever the locale; false if the word is not just that.
bool ParseNumber(std::string_view word, double* value);

// Decimal seconds, such as -12.5, 1317384506.400123001 or 1.037360e-01, to nanoseconds without a
// detour over double, which has no room for the nanoseconds of an epoch stamp. Digits beyond are
// rounded. False if the word is no such number or does not fit.
bool ParseSecondsNs(std::string_view word, StampNs* stamp_ns);

// A rotation out of a text: R must be orthonormal within 1e-3 in each entry of R'R and of
// determinant +1 and is then set to the nearest true rotation. False if the rule is broken.
bool RepairRotation(Eigen::Matrix3d* R);

// The pose of 12 numbers, row-major [R | t]. Throws InputError at the line of `lines` if there are
// more or fewer, one is not finite, or R is not a rotation.
SE3 PoseFromRowMajor(const std::vector<double>& numbers, const LineReader& lines);

}  // namespace lamina
