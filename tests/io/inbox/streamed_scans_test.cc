#include "io/inbox/streamed_scans.h"

#include "tests/support/files/io_test_files.h"

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

TEST_F(StreamedScansTest, StampsBeforeAScanAreThoseOfItsRecording) {
  using testing::ElementsAre;
  StreamedScans scans(3, options_);
  scans.AppendPast("b", 1, 100);
  const std::string recordings[] = {"a", "b", "b", "a", "a"};  // scans 3 to 7
  for (int i = 0; i < 5; ++i) scans.Append(File(i + 3, recordings[i]));
  EXPECT_EQ(scans.Recording(5), "b");
  EXPECT_THAT(scans.StampsUpTo(3, 0, 5), ElementsAre(300));
  EXPECT_THAT(scans.StampsUpTo(5, 0, 5), ElementsAre(100, 400, 500));
  EXPECT_THAT(scans.StampsUpTo(5, 0, 2), ElementsAre(400, 500));
  EXPECT_THAT(scans.StampsUpTo(7, 0, 5), ElementsAre(300, 600, 700));
  EXPECT_THAT(scans.StampsUpTo(7, 4, 5), ElementsAre(600, 700));
}

TEST_F(StreamedScansTest, ForgetsAllButAFewStampsBeforeTheNext) {
  StreamedScans scans(0, options_);
  for (int i = 0; i < 80; ++i) scans.Append(File(i, i % 2 == 0 ? "a" : "b"));
  scans.Forget(60);
  EXPECT_EQ(scans.size(), 80U);
  EXPECT_EQ(scans.Stamp(60), 6000);
  EXPECT_THROW(scans.File(59), std::out_of_range);
  const auto stamps = [&](std::size_t i) { return scans.StampsUpTo(i, 0, 100); };
  EXPECT_EQ(stamps(61).size(), StreamedScans::kHistory + 1);
  EXPECT_EQ(stamps(60).size(), StreamedScans::kHistory + 1);
  EXPECT_EQ(stamps(60).front(), static_cast<StampNs>(100 * (60 - 2 * StreamedScans::kHistory)));
  scans.Forget(5);  // not backwards
  EXPECT_EQ(stamps(60).size(), StreamedScans::kHistory + 1);
  scans.Append(File(80, "a"));
  EXPECT_EQ(scans.File(80).name, "a/80");
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
