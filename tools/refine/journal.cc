#include "tools/refine/journal.h"

#include <cstring>
#include <filesystem>
#include <string_view>
#include <utility>

#include "core/geometry/state_archive.h"
#include "io/file/checksum.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

constexpr std::string_view kMagic = "LAMINARJ";

std::string Head(std::uint32_t made_of) {
  StateArchive head;
  head(&made_of);
  return std::string(kMagic) + head.written();
}

std::string Record(std::string key, std::string result) {
  StateArchive body, whole;
  body(&key, &result);
  std::uint32_t checksum = Crc32(body.written());
  whole(&checksum, &body.written());
  return whole.written();
}

}  // namespace

JournalFile::JournalFile(std::string path, std::uint32_t made_of)
    : path_(std::move(path)), file_(path_, ByteFile::Lifetime::kKept) {
  const std::string head = Head(made_of), bytes = ReadFile(path_);
  if (bytes.compare(0, head.size(), head) == 0) {
    whole_ = head.size();
    Read(bytes);
  }
  file_.RollBackTo(whole_);
  if (whole_ == 0) file_.Append(head);
}

void JournalFile::Read(const std::string& bytes) {
  try {
    StateArchive archive{std::string_view(bytes).substr(whole_)};
    while (archive.unread() > 0) {
      std::uint32_t checksum = 0;
      std::string body, key, result;
      archive(&checksum, &body);
      if (Crc32(body) != checksum) return;
      StateArchive record{std::string_view(body)};
      record(&key, &result);
      results_[key] = result;
      whole_ = bytes.size() - archive.unread();
      ++found_;
    }
  } catch (const InputError&) {
    // The last one was under way.
  }
}

std::optional<std::string> JournalFile::Find(const std::string& key) const {
  const auto found = results_.find(key);
  if (found == results_.end()) return std::nullopt;
  return found->second;
}

void JournalFile::Add(const std::string& key, const std::string& result) {
  results_[key] = result;
  file_.Append(Record(key, result));
}

void JournalFile::Remove() {
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

}  // namespace lamina
