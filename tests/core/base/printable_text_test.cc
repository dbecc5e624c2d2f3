#include "core/base/printable_text.h"

#include <gtest/gtest.h>

#include <random>

namespace lamina {
namespace {

using namespace std::string_literals;

TEST(Printable, LeavesReadableTextAsItIs) {
  for (const std::string text :
       {"", "plain, with \"quotes\" and a \\ backslash", "Straße 中文 😀 a\xc2\xa0z", "50 % {}"}) {
    EXPECT_EQ(Printable(text), text);
  }
}

TEST(Printable, ShowsEveryOtherByte) {
  EXPECT_EQ(Printable("a\x1b[31mred\x07"), "a\\x1b[31mred\\x07");
  EXPECT_EQ(Printable("one\ntwo\r\tthree"), "one\\x0atwo\\x0d\\x09three");
  EXPECT_EQ(Printable("nul\0l"s), "nul\\x00l");
  EXPECT_EQ(Printable("\x7f"), "\\x7f");
  // As UTF-8, what terminals take for ESC [; and a mark that turns the line around.
  EXPECT_EQ(Printable("\xc2\x9b"
                      "31m"),
            "\\xc2\\x9b31m");
  EXPECT_EQ(Printable("a\xe2\x80\xae"
                      "b"),
            "a\\xe2\\x80\\xaeb");
}

TEST(Printable, ShowsBytesThatAreNoUtf8) {
  EXPECT_EQ(Printable("\xff"
                      "a\xfe"),
            "\\xffa\\xfe");
  EXPECT_EQ(Printable("\x80"), "\\x80");
  // Cut short, overlong, surrogate, beyond the last character.
  EXPECT_EQ(Printable("\xe4\xb8"), "\\xe4\\xb8");
  EXPECT_EQ(Printable("\xe4"
                      "abc"),
            "\\xe4"
            "abc");
  EXPECT_EQ(Printable("\xc0\xaf"), "\\xc0\\xaf");
  EXPECT_EQ(Printable("\xe0\x80\x9b"), "\\xe0\\x80\\x9b");
  EXPECT_EQ(Printable("\xed\xa0\x80"), "\\xed\\xa0\\x80");
  EXPECT_EQ(Printable("\xf4\x90\x80\x80"), "\\xf4\\x90\\x80\\x80");
}

TEST(Printable, HasNoControlBytesAndIsTheSameTwice) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    std::string text(random() % 20, ' ');
    for (char& c : text) c = static_cast<char>(random() % 256);
    const std::string printable = Printable(text);
    for (const char c : printable) {
      EXPECT_GE(static_cast<unsigned char>(c), 0x20);
      EXPECT_NE(c, '\x7f');
    }
    EXPECT_EQ(Printable(printable), printable);
  }
}

}  // namespace
}  // namespace lamina
