#include "io/store/checkpoint_file.h"

namespace lamina {
namespace {

constexpr std::string_view kMagic = "LAMINAMP";
constexpr std::uint32_t kVersion = 42;
constexpr SectionFileKind kKind = {kMagic, kVersion, "a checkpoint"};

}  // namespace

CheckpointWriter::CheckpointWriter(const std::string& path) : SectionWriter(path, kKind) {}
CheckpointReader::CheckpointReader(const std::string& path) : SectionReader(path, kKind) {}

}  // namespace lamina
