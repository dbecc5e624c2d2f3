// What headers say about the length of their file, at every length that it has while it is written.
#include "io/points/point_file_check.h"

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

std::string PlainPcdHeader(const std::string& data) {
  return "# .PCD v.7\nVERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\n"
         "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA " +
         data + "\n";
}

std::string PlainPlyHeader(const std::string& format) {
  return "ply\nformat " + format +
         " 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
         "element face 1\nproperty list uchar int vertex_index\nend_header\n";
}

using Declared = std::optional<std::size_t> (*)(std::string_view);

// No beginning of the file is taken for the whole.
void ExpectWholeOnlyAt(const Declared& declared, const std::string& file, std::size_t whole) {
  for (std::size_t size = 0; size <= file.size(); ++size) {
    const auto bytes = declared(std::string_view(file).substr(0, size));
    EXPECT_EQ(bytes && size >= *bytes, size >= whole) << size;
  }
}

TEST(DeclaredBytesTest, BinaryFilesAreWholeWithTheirLastPoint) {
  const std::string points = Pack(1.0F, 2.0F, 3.0F, 4.0F, 5.0F, 6.0F);
  const std::string pcd = PlainPcdHeader("binary") + points;
  ExpectWholeOnlyAt(DeclaredPcdBytes, pcd + "more", pcd.size());
  const std::string ply = PlainPlyHeader("binary_little_endian") + points;
  ExpectWholeOnlyAt(DeclaredPlyBytes, ply + '\0', ply.size() + 1);  // an empty list
}

TEST(DeclaredBytesTest, CompressedFilesSayHowMuchTheyPack) {
  const std::string pcd =
      PlainPcdHeader("binary_compressed") + Pack(std::uint32_t{5}, std::uint32_t{24}) + "\n\n567";
  ExpectWholeOnlyAt(DeclaredPcdBytes, pcd, pcd.size());
}

TEST(DeclaredBytesTest, TextHasALowerBound) {
  const std::string pcd = PlainPcdHeader("ascii") + "1 2 3\n4 5 6";
  ExpectWholeOnlyAt(DeclaredPcdBytes, pcd, pcd.size());
  const std::string ply = PlainPlyHeader("ascii") + "1 2 3\n4 5 6\n0";
  ExpectWholeOnlyAt(DeclaredPlyBytes, ply, ply.size());
}

TEST(DeclaredBytesTest, MoreBytesDoNotHealABrokenHeader) {
  EXPECT_EQ(DeclaredPcdBytes("VERSION .7\nnonsense\n"), 0U);
  EXPECT_EQ(DeclaredPcdBytes("DATA binary\n"), 0U);
  EXPECT_EQ(DeclaredPlyBytes("plx\n"), 0U);
  EXPECT_EQ(DeclaredPlyBytes("ply\nnonsense\n"), 0U);
}

}  // namespace
}  // namespace lamina
