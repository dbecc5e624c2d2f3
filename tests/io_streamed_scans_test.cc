#include "io/streamed_scans.h"

#include "io_test_files.h"

namespace lamina {
namespace {

class StreamedScansTest : public FilesTest {
 protected:
  static InboxFile File(int i, const std::string& sequence = "") {
    InboxFile file;
    file.name = sequence + "/" + std::to_string(i);
    file.path = "/none/" + file.name;
    file.sequence = sequence;
    file.stamp_ns = 100 * i;
    return file;
  }
  const ScanSourceOptions options_;
};

TEST_F(StreamedScansTest, NumbersGoOnFromTheFirst) {
  StreamedScans scans(5, options_);
  EXPECT_EQ(scans.size(), 5U);
  scans.Append(File(5));
  scans.Append(File(6));
  EXPECT_EQ(scans.size(), 7U);
  EXPECT_EQ(scans.File(6).name, "/6");
  EXPECT_EQ(scans.Name(5), "/none//5");
  EXPECT_EQ(scans.Stamp(6), 600);
  EXPECT_THROW(scans.File(4), std::out_of_range);
  EXPECT_THROW(scans.File(7), std::out_of_range);
}

// What comes after a scan must not depend on what happens to have come by now.
TEST_F(StreamedScansTest, TheNextStampIsTheOneThatTheInboxTold) {
  StreamedScans scans(0, options_);
  InboxFile first = File(0);
  first.next_stamp_ns = 77;
  scans.Append(first);
  scans.Append(File(1));
  scans.Append(File(2));
  EXPECT_EQ(scans.StampAfter(0), StampNs{77});
  EXPECT_EQ(scans.StampAfter(1), std::nullopt);
}

TEST_F(StreamedScansTest, RunsAreOfOneSequence) {
  StreamedScans scans(3, options_);
  const std::string sequences[] = {"a", "a", "b", "a", "a", "a"};  // scans 3 to 8
  for (int i = 0; i < 6; ++i) scans.Append(File(i, sequences[i]));
  const std::size_t begins[] = {3, 3, 5, 6, 6, 6}, ends[] = {5, 5, 6, 9, 9, 9};
  for (std::size_t i = 3; i < 9; ++i) {
    EXPECT_EQ(scans.RunBegin(i), begins[i - 3]) << "scan " << i;
    EXPECT_EQ(scans.RunEnd(i), ends[i - 3]) << "scan " << i;
  }
}

TEST_F(StreamedScansTest, ForgetsAllButAFewBeforeTheNext) {
  StreamedScans scans(0, options_);
  for (int i = 0; i < 40; ++i) scans.Append(File(i));
  scans.Forget(StreamedScans::kHistory);
  EXPECT_EQ(scans.Stamp(0), 0);
  scans.Forget(30);
  EXPECT_EQ(scans.size(), 40U);
  const std::size_t first = 30 - StreamedScans::kHistory;
  EXPECT_EQ(scans.Stamp(first), static_cast<StampNs>(100 * first));
  EXPECT_THROW(scans.File(first - 1), std::out_of_range);
  EXPECT_EQ(scans.RunBegin(35), first);
  scans.Forget(5);  // not backwards
  EXPECT_EQ(scans.RunBegin(35), first);
  scans.Append(File(40));
  EXPECT_EQ(scans.File(40).name, "/40");
  scans.Forget(41);
  EXPECT_EQ(scans.RunBegin(40), 41 - StreamedScans::kHistory);
}

TEST_F(StreamedScansTest, ReadsAsARecordingDoes) {
  const std::vector<ScanPoint> points = {{1, 2, 3, 4}, {5, 6, 7, 8}};
  InboxFile file = File(0);
  file.path = Write("scan.bin", KittiBin(points));
  file.stamp_ns = 1234;
  file.recorded_stamp = true;
  StreamedScans scans(7, options_);
  scans.Append(file);
  const Scan scan = scans.Read(7);
  EXPECT_EQ(scan.stamp_ns, 1234);
  EXPECT_EQ(KittiBin(scan.points), KittiBin(points));
  std::filesystem::remove(file.path);
  EXPECT_THAT(MessageOf<InputError>([&] { scans.Read(7); }), testing::HasSubstr("scan.bin"));
}

}  // namespace
}  // namespace lamina
