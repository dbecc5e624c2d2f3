#include "backend/bundle/block_products.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// With the instructions of this processor as with plain ones, to the last bit.
TEST(BlockProducts, HaveTheBitsOfThePlainFormula) {
  Draws draws(1);
  for (int run = 0; run < 200; ++run) {
    const auto count = static_cast<std::size_t>(draws.Integer(1, 12));
    std::vector<PlaneRows> rows(count);
    std::vector<std::int32_t> frames(count);
    for (std::size_t k = 0; k < count; ++k) {
      for (int i = 0; i < 18; ++i) rows[k](i / 6, i % 6) = draws.Uniform(-1e3, 1e3);
      frames[k] = static_cast<std::int32_t>(2 * k);
    }
    std::vector<double> strip(36 * 2 * count);
    for (double& value : strip) value = draws.Uniform(-1e6, 1e6);
    std::vector<double> expected = strip;
    const PlaneRows& mine = rows.back();
    for (std::size_t k = 0; k < count; ++k) {
      for (int c = 0; c < 6; ++c) {
        for (int r = 0; r < 6; ++r) {
          volatile double sum = mine(0, r) * rows[k](0, c);
          volatile double next = mine(1, r) * rows[k](1, c);
          sum = sum + next;
          next = mine(2, r) * rows[k](2, c);
          sum = sum + next;
          expected[36 * static_cast<std::size_t>(frames[k]) +
                   static_cast<std::size_t>(6 * c + r)] -= sum;
        }
      }
    }
    SubtractProducts(rows.data(), frames.data(), count, strip.data());
    EXPECT_EQ(strip, expected);
  }
}

}  // namespace
}  // namespace lamina
