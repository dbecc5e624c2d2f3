// Checkpoints on disk: files of sections (io/file/section_file.h) that begin with "LAMINAMP". What
// the sections hold is for others to say (backend/session/checkpoint.h).
#pragma once

#include <string>

#include "io/file/section_file.h"

namespace lamina {

class CheckpointWriter : public SectionWriter {
 public:
  explicit CheckpointWriter(const std::string& path);
};

class CheckpointReader : public SectionReader {
 public:
  explicit CheckpointReader(const std::string& path);
};

}  // namespace lamina
