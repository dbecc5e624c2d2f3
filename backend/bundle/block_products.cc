#include "backend/bundle/block_products.h"

#include <cstring>

#include "core/base/processor.h"

namespace lamina {

LAMINA_FOR_EACH_PROCESSOR
void SubtractProducts(const PlaneRows* rows, const std::int32_t* frames, std::size_t count,
                      double* strip) {
  // Two columns of a block are twelve numbers: rows 0 to 3 of the first, 4 and 5 of it with 0 and 1
  // of the second, and 2 to 5 of that one.
  const double* a = rows[count - 1].data();
  Four mine[3][3];
  for (int r = 0; r < 3; ++r, a += 6) {
    mine[r][0] = Four{a[0], a[1], a[2], a[3]};
    mine[r][1] = Four{a[4], a[5], a[0], a[1]};
    mine[r][2] = Four{a[2], a[3], a[4], a[5]};
  }
  for (std::size_t k = 0; k < count; ++k) {
    const double* b = rows[k].data();
    double* block = strip + 36 * static_cast<std::size_t>(frames[k]);
    for (int c = 0; c < 6; c += 2, block += 12) {
      Four sum[3];
      for (int r = 0; r < 3; ++r) {
        const double first = b[6 * r + c], second = b[6 * r + c + 1];
        const Four left{first, first, first, first}, right{second, second, second, second};
        const Four both{first, first, second, second};
        const Four products[3] = {mine[r][0] * left, mine[r][1] * both, mine[r][2] * right};
        for (int i = 0; i < 3; ++i) sum[i] = r == 0 ? products[i] : sum[i] + products[i];
      }
      for (int i = 0; i < 3; ++i) {
        Four value;
        std::memcpy(&value, block + 4 * i, sizeof(value));
        value -= sum[i];
        std::memcpy(block + 4 * i, &value, sizeof(value));
      }
    }
  }
}

}  // namespace lamina
