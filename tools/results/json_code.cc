#include "tools/results/json_code.h"

LAMINA_JSON_CODE()
