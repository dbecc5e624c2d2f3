// The options of mapping, all that decide results together.
#pragma once

#include "backend/mapping/mapper.h"
#include "backend/mapping/scan_decoder.h"
#include "frontend/scan_preparation.h"

namespace lamina {

struct MappingOptions {
  ScanPreparationOptions preparation;
  MapperOptions mapper;
  PipelineOptions pipeline;
};

}  // namespace lamina
