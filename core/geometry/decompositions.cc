#include "core/geometry/decompositions.h"

LAMINA_DECOMPOSITIONS()
