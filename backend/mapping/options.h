// The options of mapping, all that decide results together.
#pragma once

#include "backend/loops/loop_options.h"
#include "backend/pieces/mapper_options.h"
#include "core/options/options.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

struct PipelineOptions {
  // Scans that may be under way at once.
  int lookahead_scans = 4;
  // A scan with fewer usable points is skipped.
  int min_points = 100;
  // Recordings (folders of an inbox) that are mapped at once. When one more comes, the one that was
  // silent longest is ended.
  int max_recordings = 8;

  void Visit(OptionVisitor& v);
};

struct MappingOptions {
  ScanPreparationOptions preparation;
  MapperOptions mapper;
  PipelineOptions pipeline;
  LoopOptions loops;
};

}  // namespace lamina
