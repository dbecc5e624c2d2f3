// Generated places in which a sensor is to find itself without a start.
#pragma once

#include <string>
#include <vector>

namespace lamina {

struct LocalisationCase {
  std::string name;
  std::string config;  // shipped configuration; empty: defaults
  std::string map;     // options of `lamina synth` for the drive that makes the map
  std::string visit;   // more of them, for the drive that windows are taken from
  // Standard deviation of how far the sensor leans in a window, about a horizontal axis.
  double tilt_deg = 3.0;
  // Options instead of both of these, for a drive through another place; empty: the visit with
  // another seed. "-": there is none.
  std::string elsewhere = "";
};

const std::vector<LocalisationCase>& LocalisationCases();

}  // namespace lamina
