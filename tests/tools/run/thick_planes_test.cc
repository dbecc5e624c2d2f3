#include "tools/run/thick_planes.h"

#include <gmock/gmock.h>

#include "backend/mapping/mapping.h"
#include "tools/synth/sequence.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

// Of a drive through a street by a sensor whose beams are off by that share of half a degree, 0.3
// degrees a beam and 5 cm a beam.
std::string WarningWith(double errors) {
  SynthOptions synth;
  synth.frames = 25;
  synth.sensor = synth::SensorKind::kSpinning;
  synth.rings = 64;
  synth.points = 20000;
  synth.noise_m = 0.01;
  synth.errors.beam_elevation_offset_deg = 0.5 * errors;
  synth.errors.beam_elevation_sigma_deg = 0.3 * errors;
  synth.errors.beam_range_sigma_m = 0.05 * errors;
  const SynthSequence sequence(synth);
  const MappingOptions options;
  Mapping mapping(options);
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    Scan scan = sequence.Generate(i);
    scan.stamp_ns = sequence.Stamp(i);
    mapping.Add(scan);
  }
  mapping.Finish();
  return ThickPlanesWarning(MeasureThickness(mapping.map(), 2), options);
}

TEST(ThickPlanes, AnExactSensorIsNotDoubted) { EXPECT_THAT(WarningWith(0.0), IsEmpty()); }

TEST(ThickPlanes, BeamsThatAreOffAreNamedWithWhatWouldMendThem) {
  const std::string warning = WarningWith(1.0);
  EXPECT_THAT(warning, HasSubstr("preparation.vertical_correction_deg"));
  EXPECT_THAT(warning, HasSubstr("lamina calibrate"));
}

}  // namespace
}  // namespace lamina
