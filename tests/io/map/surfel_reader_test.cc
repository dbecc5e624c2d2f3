#include "io/map/surfel_reader.h"

#include <limits>

#include "io/map/map_io.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class SurfelReaderTest : public FilesTest {
 protected:
  static Surfel Numbered(int i) {
    const auto x = static_cast<float>(i);
    return {Eigen::Vector3d(i, -i, 0.5), {0.0F, 0.6F, 0.8F}, {0.3F, 0.2F, 0.001F * x}, 100U};
  }
  std::string Written(int count) const {
    SurfelMap map;
    for (int i = 0; i < count; ++i) map.push_back(Numbered(i));
    WriteSurfels(Path("map.ply"), map);
    return Path("map.ply");
  }
  std::string MessageFor(const std::string& bytes) const {
    return MessageOf<InputError>([&] {
      SurfelReader reader(Write("bad.ply", bytes));
      for (Surfel s; reader.Next(&s);) continue;
    });
  }
  // A file with its first `from` replaced.
  std::string With(const std::string& from, const std::string& to) const {
    std::string bytes = Bytes(Written(2));
    return bytes.replace(bytes.find(from), from.size(), to);
  }
};

TEST_F(SurfelReaderTest, ReadsBackWhatWasWritten) {
  // More than a buffer holds.
  constexpr int kCount = 50000;
  SurfelReader reader(Written(kCount));
  EXPECT_EQ(reader.size(), static_cast<std::size_t>(kCount));
  Surfel s;
  int i = 0;
  for (; reader.Next(&s); ++i) {
    const Surfel expected = Numbered(i);
    ASSERT_EQ(s.centre, expected.centre) << i;
    ASSERT_EQ(s.normal, expected.normal) << i;
    ASSERT_EQ(s.eigenvalues, expected.eigenvalues) << i;
    ASSERT_EQ(s.count, expected.count) << i;
  }
  EXPECT_EQ(i, kCount);
  EXPECT_FALSE(reader.Next(&s));
}

TEST_F(SurfelReaderTest, AnEmptyMapIsAMap) {
  SurfelReader reader(Written(0));
  EXPECT_EQ(reader.size(), 0U);
  Surfel s;
  EXPECT_FALSE(reader.Next(&s));
}

TEST_F(SurfelReaderTest, BadFilesAreNamedWithTheRule) {
  EXPECT_THAT(MessageOf<InputError>([&] { SurfelReader reader(Path("none.ply")); }),
              HasSubstr("none.ply"));
  EXPECT_THAT(MessageFor(""), AllOf(HasSubstr("bad.ply"), HasSubstr("no PLY")));
  EXPECT_THAT(MessageFor("ply\nformat binary_little_endian 1.0\n"), HasSubstr("no PLY"));
  EXPECT_THAT(MessageFor(With("binary_little_endian", "ascii")), HasSubstr("binary"));
  EXPECT_THAT(MessageFor(With("property float l3", "property float k3")), HasSubstr("l3"));
  EXPECT_THAT(MessageFor(With("property float ny", "property int ny")), HasSubstr("ny"));
  EXPECT_THAT(MessageFor(With("property float x", "property list uchar int x")),
              HasSubstr("bad.ply:5"));
  EXPECT_THAT(MessageFor(With("element vertex 2", "element vertex 3")), HasSubstr("announced"));
  EXPECT_THAT(MessageFor(With("element vertex 2", "element vertex 18446744073709551615")),
              HasSubstr("announced"));
  EXPECT_THAT(MessageFor(With("element vertex 2", "element vertex -1")), HasSubstr("whole number"));
  EXPECT_THAT(MessageFor(With("element vertex", "element face")), HasSubstr("one element"));
  const std::string nan = Pack(std::numeric_limits<float>::quiet_NaN());
  EXPECT_THAT(MessageFor(With("end_header\n" + Pack(0.0F), "end_header\n" + nan)),
              HasSubstr("surfel 0 is not finite"));
}

}  // namespace
}  // namespace lamina
