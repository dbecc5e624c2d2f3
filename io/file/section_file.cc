#include "io/file/section_file.h"

#include <fmt/format.h>

#include <cstring>

#include "core/base/error.h"
#include "core/geometry/state_archive.h"
#include "io/file/checksum.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

constexpr std::string_view kEnd = "END ";
constexpr std::size_t kTagSize = 4;

struct SectionHead {
  char tag[kTagSize] = {};
  std::uint32_t crc = 0;
  std::uint64_t size = 0;
};
static_assert(sizeof(SectionHead) == 16, "written as it lies in memory");

std::uint32_t SectionCrc(std::string_view tag, std::string_view bytes) {
  return Crc32(bytes, Crc32(tag));
}

}  // namespace

SectionWriter::SectionWriter(const std::string& path, const SectionFileKind& kind) : writer_(path) {
  StateArchive head;
  std::uint32_t version = kind.version;
  head(&version);
  writer_.Write(kind.magic);
  writer_.Write(head.written());
  bytes_ = kind.magic.size() + head.written().size();
}

void SectionWriter::Write(std::string_view tag, std::string_view bytes) {
  if (tag.size() != kTagSize) throw std::logic_error("a section's tag has 4 characters");
  SectionHead head;
  std::memcpy(head.tag, tag.data(), kTagSize);
  head.crc = SectionCrc(tag, bytes);
  head.size = bytes.size();
  writer_.Write(std::string_view(reinterpret_cast<const char*>(&head), sizeof(head)));
  writer_.Write(bytes);
  bytes_ += sizeof(head) + bytes.size();
  ++sections_;
}

void SectionWriter::Commit() {
  StateArchive count;
  count(&sections_);
  Write(kEnd, count.written());
  writer_.Commit();
}

struct SectionReader::Impl {
  explicit Impl(const std::string& file) : path(file), input(file), left(input.size()) {}

  void Read(void* to, std::size_t bytes) {
    if (bytes > left) throw InputError(fmt::format("{}: ends too early", path));
    input.Read(to, bytes);
    left -= bytes;
  }

  std::string path;
  InputFile input;
  std::uint64_t left, sections = 0, at = 0;
};

SectionReader::SectionReader(const std::string& path, const SectionFileKind& kind)
    : impl_(std::make_unique<Impl>(path)) {
  std::string magic(kind.magic.size(), ' ');
  std::uint32_t version = 0;
  impl_->Read(magic.data(), magic.size());
  impl_->Read(&version, sizeof(version));
  if (magic != kind.magic)
    throw InputError(fmt::format("{}: is not {} of Lamina", path, kind.name));
  if (version != kind.version) {
    throw OtherFormatError(fmt::format("{}: is of version {}, this program reads version {}", path,
                                       version, kind.version));
  }
}

SectionReader::~SectionReader() = default;

std::uint64_t SectionReader::at() const { return impl_->at; }

bool SectionReader::Next(std::string* tag, std::string* bytes) {
  SectionHead head;
  impl_->Read(&head, sizeof(head));
  if (head.size > impl_->left) throw InputError(fmt::format("{}: ends too early", impl_->path));
  tag->assign(head.tag, kTagSize);
  bytes->resize(static_cast<std::size_t>(head.size));
  impl_->at = impl_->input.size() - impl_->left;
  impl_->Read(bytes->data(), bytes->size());
  if (SectionCrc(*tag, *bytes) != head.crc) {
    throw InputError(fmt::format("{}: is damaged: the checksum of section {} differs", impl_->path,
                                 impl_->sections));
  }
  if (*tag != kEnd) {
    ++impl_->sections;
    return true;
  }
  std::uint64_t count = 0;
  StateArchive archive{std::string_view(*bytes)};
  archive(&count);
  if (count != impl_->sections || impl_->left > 0) {
    throw InputError(fmt::format("{}: is damaged: sections are missing", impl_->path));
  }
  return false;
}

}  // namespace lamina
