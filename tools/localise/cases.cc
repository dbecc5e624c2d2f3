#include "tools/localise/cases.h"

namespace lamina {

const std::vector<LocalisationCase>& LocalisationCases() {
  // Rooms and stairwells of all seeds have the same walls: another scene is another place. Visits
  // of another speed or drive: no scan is taken from where one of the map was.
  static const std::vector<LocalisationCase> cases = {
      {"room-vlp16", "handheld", "--scene room --sensor vlp16 --frames 250", "--speed 0.67", 8.0,
       "--scene hall --sensor vlp16 --frames 500"},
      {"room-os1", "handheld", "--scene room --sensor os1 --frames 250", "--speed 0.67", 8.0,
       "--scene hall --sensor os1 --frames 500"},
      {"room-avia", "livox_avia", "--scene room --sensor avia --frames 250", "--speed 0.67", 8.0,
       "--scene hall --sensor avia --frames 500"},
      {"hall-vlp16", "handheld", "--scene hall --sensor vlp16 --frames 950", "--speed 1.3", 8.0,
       "--scene room --sensor vlp16 --frames 250"},
      {"hall-os1", "handheld", "--scene hall --sensor os1 --frames 950", "--speed 1.3", 8.0,
       "--scene room --sensor os1 --frames 250"},
      {"stairs-os1", "handheld", "--scene stairs --sensor os1 --frames 500", "--speed 0.9", 5.0,
       "--scene room --sensor os1 --frames 250"},
      {"forest-vlp16", "handheld", "--scene forest --sensor vlp16 --frames 800", "--speed 1.5",
       8.0},
      {"forest-os1", "handheld", "--scene forest --sensor os1 --frames 800", "--speed 1.5", 8.0},
      {"street-vlp16", "", "--scene street --sensor vlp16 --frames 500", "--speed 9"},
      {"street-os1", "", "--scene street --sensor os1 --frames 500", "--speed 9"},
      {"city-vlp16", "", "--scene city --route tour --loop-blocks 2 --sensor vlp16 --frames 1400",
       "--drive 1"},
      {"city-os1", "", "--scene city --route tour --loop-blocks 2 --sensor os1 --frames 1400",
       "--drive 1"},
      {"city-hdl64", "",
       "--scene city --route tour --loop-blocks 2 --sensor hdl64 --points 60000 --frames 1400",
       "--drive 1"},
      {"bays-vlp16", "", "--scene bays --sensor vlp16 --frames 250", "--speed 13", 3.0, "-"},
      {"bays-hdl64", "", "--scene bays --sensor hdl64 --points 60000 --frames 250", "--speed 13",
       3.0, "-"},
      {"corridor-os1", "handheld", "--scene corridor --sensor os1 --frames 250", "--speed 1.3", 8.0,
       "-"},
  };
  return cases;
}

}  // namespace lamina
