// Recordings: layouts, order, stamps.
#include "io/recording/scan_source.h"

#include <fmt/format.h>
#include <unistd.h>

#include <vector>

#include "tests/io/points/scan_file_fixture.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::EndsWith;
using testing::FloatNear;
using testing::HasSubstr;
using testing::Pointwise;

class ScanSourceTest : public FilesTest {
 protected:
  std::unique_ptr<ScanSource> Open(const std::string& name) const {
    return OpenScans(Path(name), options_);
  }
  std::string OpenError(const std::string& name) const {
    return MessageOf<InputError>([&] { Open(name); });
  }
  // One-point scans; x is the position in `names`.
  void WriteScans(const std::string& folder, const std::vector<std::string>& names) const {
    for (std::size_t i = 0; i < names.size(); ++i) {
      Write(folder + "/" + names[i], KittiBin({{static_cast<float>(i), 0, 0, 0}}));
    }
  }
  static std::vector<StampNs> Stamps(const ScanSource& source) {
    std::vector<StampNs> stamps;
    for (std::size_t i = 0; i < source.size(); ++i) stamps.push_back(source.Stamp(i));
    return stamps;
  }
  static std::vector<std::string> Names(const ScanSource& source) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < source.size(); ++i) {
      names.push_back(fs::path(source.Name(i)).filename().string());
    }
    return names;
  }

  ScanSourceOptions options_;
};

TEST_F(ScanSourceTest, KittiOdometry) {
  WriteScans("00/velodyne", {"000000.bin", "000001.bin"});
  Write("00/times.txt", "0.000000e+00\n1.036940001e-01\n99\n");
  Write("00/calib.txt", "P0: 1 2 3\n\nTr: 0 -1 0 0.5  0 0 -1 0  1 0 0 -0.25\n");
  for (const char* path : {"00", "00/", "00/velodyne", "00/velodyne/"}) {
    const auto source = Open(path);
    EXPECT_THAT(Stamps(*source), ElementsAre(0, 103694000)) << path;
    const Scan scan = source->Read(1);
    EXPECT_EQ(scan.stamp_ns, 103694000);
    EXPECT_EQ(scan.points[0].x, 1.0F);
    EXPECT_THAT(source->Name(1), EndsWith("velodyne/000001.bin"));
    EXPECT_LT(
        (source->T_camera_lidar() * Eigen::Vector3d(1, 2, 3) - Eigen::Vector3d(-1.5, -3, 0.75))
            .norm(),
        1e-12);
  }
}

TEST_F(ScanSourceTest, KittiOdometryWithoutTimesAndCalibration) {
  WriteScans("00/velodyne", {"000000.bin", "000001.bin", "000002.bin"});
  options_.frame_period_s = 0.25;
  const auto source = Open("00");
  EXPECT_THAT(Stamps(*source), ElementsAre(0, 250000000, 500000000));
  EXPECT_EQ(source->T_camera_lidar().R(), Eigen::Matrix3d::Identity());
}

TEST_F(ScanSourceTest, KittiRawKeepsNanoseconds) {
  const std::string root = "drive/velodyne_points";
  WriteScans(root + "/data", {"0000000000.bin", "0000000001.bin"});
  Write(root + "/timestamps.txt", "2011-09-26 13:02:25.594360375\r\n2011-09-26 13:02:25.697\r\n");
  for (const std::string& path : {std::string("drive"), root, root + "/data"}) {
    EXPECT_THAT(Stamps(*Open(path)), ElementsAre(1317042145594360375, 1317042145697000000)) << path;
  }
}

TEST_F(ScanSourceTest, KittiRawInTextWithScansLeftOut) {
  Write("d/velodyne_points/data/0000000000.txt", "1 2 3 0.5\n");
  Write("d/velodyne_points/data/0000000002.txt", "4 5 6 0.5\n");
  Write("d/velodyne_points/timestamps.txt",
        "1970-01-01 00:00:01.0\n1970-01-01 00:00:02.0\n1970-01-01 00:00:03.0\n");
  const auto source = Open("d");
  EXPECT_THAT(Stamps(*source), ElementsAre(1000000000, 3000000000));
  EXPECT_EQ(source->Read(1).points[0].x, 4.0F);
}

TEST_F(ScanSourceTest, FurtherLinesAreFineWhereNamesAreNoLineNumbers) {
  WriteScans("s", {"a.bin", "b.bin"});
  Write("s/times.txt", "0\n1\n2\n");
  EXPECT_THAT(Stamps(*Open("s")), ElementsAre(0, 1000000000));
}

TEST_F(ScanSourceTest, PlainFolderInNaturalOrder) {
  WriteScans("s", {"scan10.bin", "scan2.bin", "scan02.bin", "scan.bin", "scan2b.bin"});
  WriteScans("s", {".hidden.bin", "notes.md"});
  fs::create_directory(Path("s/folder.bin"));
  const auto source = Open("s");
  EXPECT_THAT(Names(*source),
              ElementsAre("scan.bin", "scan02.bin", "scan2.bin", "scan2b.bin", "scan10.bin"));
  EXPECT_EQ(source->Stamp(4), 400000000);
  EXPECT_TRUE(source->Read(4).stamp_made_up);
  Write("s/times.txt", "0\n1\n2\n4\n8\n");
  EXPECT_FALSE(Open("s")->Read(4).stamp_made_up);
}

// By made-up stamps times tell where in its sweep a point was measured, and no more.
TEST_F(ScanSourceTest, TimesFitStampsThatAreMadeUp) {
  const auto write = [&](const std::string& name, double first_s, double last_s) {
    Write(name, PcdHeader("x y z t", "4 4 4 8", "F F F F", "2", "ascii") +
                    fmt::format("1 2 3 {}\n4 5 6 {}\n", first_s, last_s));
  };
  // A sensor of 5 Hz, at an assumed 10 Hz.
  write("slow/1.pcd", -0.1, 0.1);
  auto source = Open("slow");
  EXPECT_THAT(source->Read(0).time_s, Pointwise(FloatNear(1e-6F), {-0.05F, 0.05F}));
  EXPECT_THAT(source->Describe().doubts, ElementsAre(HasSubstr("scans.frame_period_s=0.2")));
  options_.frame_period_s = 0.2;
  source = Open("slow");
  EXPECT_THAT(source->Read(0).time_s, Pointwise(FloatNear(1e-6F), {-0.1F, 0.1F}));
  EXPECT_THAT(source->Describe().doubts, testing::IsEmpty());
  options_.frame_period_s = 0.1;
  // A clock that began with the recording.
  write("clock/1.pcd", 0.0, 0.09);
  write("clock/2.pcd", 0.1, 0.19);
  EXPECT_THAT(Open("clock")->Read(1).time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.09F}));
  // A stamp in the middle of the sweep, or one that is a little early, stays.
  write("late/1.pcd", 0.02, 0.11);
  EXPECT_THAT(Open("late")->Read(0).time_s, Pointwise(FloatNear(1e-6F), {0.02F, 0.11F}));
}

TEST_F(ScanSourceTest, StampsFromNames) {
  WriteScans("ns", {"1700000000123456789.bin", "1700000000223456789.bin"});
  EXPECT_THAT(Stamps(*Open("ns")), ElementsAre(1700000000123456789, 1700000000223456789));
  WriteScans("us", {"1700000000123456.bin"});
  EXPECT_THAT(Stamps(*Open("us")), ElementsAre(1700000000123456000));
  WriteScans("ms", {"1700000000123.bin"});
  EXPECT_THAT(Stamps(*Open("ms")), ElementsAre(1700000000123000000));
  WriteScans("s", {"1.5.bin", "1.25.bin", "1317384506.400123001.bin"});
  const auto seconds = Open("s");
  EXPECT_THAT(Stamps(*seconds), ElementsAre(1250000000, 1500000000, 1317384506400123001));
  EXPECT_THAT(Names(*seconds), ElementsAre("1.25.bin", "1.5.bin", "1317384506.400123001.bin"));
}

TEST_F(ScanSourceTest, StampsAtTheEndOfNames) {
  WriteScans("ns", {"cloud_1700000000123456789.bin", "cloud_1700000000223456789.bin"});
  EXPECT_THAT(Stamps(*Open("ns")), ElementsAre(1700000000123456789, 1700000000223456789));
  WriteScans("numbered", {"000007_1700000000123.bin", "000008_1700000000223.bin"});
  EXPECT_THAT(Stamps(*Open("numbered")), ElementsAre(1700000000123000000, 1700000000223000000));
  // Nanoseconds are a number of their own.
  WriteScans("apart", {"1700000000_900000000.bin", "1700000001_000000045.bin"});
  EXPECT_THAT(Stamps(*Open("apart")), ElementsAre(1700000000900000000, 1700000001000000045));
  WriteScans("s", {"cloud_1700000000.5.bin", "cloud_1700000000.25.bin"});
  EXPECT_THAT(Stamps(*Open("s")), ElementsAre(1700000000250000000, 1700000000500000000));
  WriteScans("nuscenes", {"n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951.pcd.bin"});
  EXPECT_THAT(Stamps(*Open("nuscenes")), ElementsAre(1532402927647951000));
  // Counters, and a day with its time.
  for (const char* name : {"scan_0000000007", "scan_1700_12", "scan_1700000000_000001",
                           "20240101123000", "scan_202401011230", "2024010112_30",
                           "scan_1700000000_1700000000", "1700000000123456789_cloud"}) {
    WriteScans(name, {std::string(name) + ".bin"});
    EXPECT_FALSE(Open(name)->recorded_stamps()) << name;
  }
}

TEST_F(ScanSourceTest, CountersAndMixedNamesAreNoStamps) {
  WriteScans("counters", {"0000000007.bin", "0000000008.bin"});
  EXPECT_THAT(Stamps(*Open("counters")), ElementsAre(0, 100000000));
  WriteScans("mixed", {"1700000000123456789.bin", "2.5.bin"});
  EXPECT_THAT(Stamps(*Open("mixed")), ElementsAre(0, 100000000));
}

// An ASCII PLY of two points with absolute times in seconds.
std::string TimedPly(const std::string& first, const std::string& second) {
  return "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
         "property float z\nproperty double t\nend_header\n1 2 3 " +
         first + "\n4 5 6 " + second + "\n";
}

TEST_F(ScanSourceTest, PointTimesOfTheSameClockAreBroughtToTheStamp) {
  Write("s/1700000000.50.ply", TimedPly("1700000000.25", "1700000000.75"));
  const auto source = Open("s");
  const Scan scan = source->Read(0);
  EXPECT_EQ(scan.stamp_ns, 1700000000500000000);
  EXPECT_EQ(scan.stamp_ns, source->Stamp(0));
  EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-6F), {-0.25F, 0.25F}));
}

TEST_F(ScanSourceTest, PointTimesOfAnotherClockCountFromTheEarliestPoint) {
  Write("s/a.ply", TimedPly("1700000000.25", "1700000000.75"));
  Write("names/1600000000.5.ply", TimedPly("1700000000.25", "1700000000.75"));
  for (const char* folder : {"s", "names"}) {
    const auto source = Open(folder);
    const Scan scan = source->Read(0);
    EXPECT_EQ(scan.stamp_ns, source->Stamp(0));
    EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.5F}));
  }
}

TEST_F(ScanSourceTest, ClocksNearZeroAreNoOffsets) {
  // A simulation's time, stamps at the end of sweeps.
  Write("sim/0.6.ply", TimedPly("0.5", "0.6"));
  Write("sim/1.7.ply", TimedPly("1.6", "1.7"));
  const auto sim = Open("sim");
  EXPECT_THAT(sim->Read(0).time_s, Pointwise(FloatNear(1e-6F), {-0.1F, 0.0F}));
  EXPECT_THAT(sim->Read(1).time_s, Pointwise(FloatNear(1e-6F), {-0.1F, 0.0F}));
  // A clock that counts within the hour: 1699999200 is a whole one.
  Write("hour/1699999199.9.ply", TimedPly("3599.8", "3599.9"));
  Write("hour/1699999200.4.ply", TimedPly("0.3", "0.4"));
  const auto hour = Open("hour");
  EXPECT_THAT(hour->Read(0).time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.1F}));
  EXPECT_THAT(hour->Read(1).time_s, Pointwise(FloatNear(1e-6F), {0.0F, 0.1F}));
  // Offsets of a part of the sweep.
  Write("part/1699999203.4.ply", TimedPly("0.3", "0.4"));
  EXPECT_THAT(Open("part")->Read(0).time_s, Pointwise(FloatNear(1e-6F), {0.3F, 0.4F}));
}

TEST_F(ScanSourceTest, ClocksOfPointsAreStampsWhereThereAreNoOthers) {
  Write("s/1.ply", TimedPly("1700000000.875", "1700000000.95"));
  Write("s/2.ply", TimedPly("1700000000.05", "1700000000.00"));
  Write("s/3.ply", "ply\nbroken");
  Write("s/4.ply", TimedPly("1700000000.25", "1700000000.40"));
  const auto source = Open("s");
  EXPECT_THAT(Stamps(*source), ElementsAre(1700000000000000000, 1700000000000000001,
                                           1700000000250000000, 1700000000875000000));
  EXPECT_THAT(source->Name(0), HasSubstr("2.ply"));
  EXPECT_THAT(source->Read(0).time_s, Pointwise(FloatNear(1e-6F), {0.05F, 0.0F}));
  EXPECT_THAT(source->Describe().doubts, ElementsAre(HasSubstr("2.ply is 0.875 s before 1.ply")));
  // A stamp file counts more, and so do names that are stamps.
  Write("s/times.txt", "1\n2\n3\n4\n");
  EXPECT_THAT(Stamps(*Open("s")), ElementsAre(1000000000, 2000000000, 3000000000, 4000000000));
  // Nor is one that stands still.
  Write("still/1.ply", TimedPly("1700000000", "1700000000"));
  Write("still/2.ply", TimedPly("1700000000", "1700000000"));
  Write("still/3.ply", TimedPly("1700000000", "1700000000"));
  EXPECT_THAT(Stamps(*Open("still")), ElementsAre(0, 100000000, 200000000));
  EXPECT_THAT(Open("still")->Describe().doubts,
              ElementsAre(HasSubstr("2 scans is that of the scan before")));
  // Clocks in some files alone are no order.
  Write("some/1.ply", TimedPly("1700000000.875", "1700000000.95"));
  Write("some/2.ply", TimedPly("0.00", "0.05"));
  EXPECT_THAT(Stamps(*Open("some")), ElementsAre(0, 100000000));
  EXPECT_THAT(Open("some")->Describe().doubts, ElementsAre(HasSubstr("those of 1 have none")));
}

TEST_F(ScanSourceTest, StampsBesideTheFolderAreUsedIfTheyFit) {
  WriteScans("drive/lidar", {"a1.bin", "a2.bin"});
  Write("drive/timestamps.txt", "7\n8\n");
  EXPECT_THAT(Stamps(*Open("drive/lidar")), ElementsAre(7000000000, 8000000000));
  Write("drive/timestamps.txt", "7\n8\n9\n");
  EXPECT_THAT(Stamps(*Open("drive/lidar")), ElementsAre(0, 100000000));
  EXPECT_THAT(Open("drive/lidar")->Describe().doubts,
              ElementsAre(HasSubstr("timestamps.txt is not used: 3 stamps for 2 scans")));
  Write("drive/timestamps.txt", "soon\n");
  EXPECT_THAT(Open("drive/lidar")->Describe().doubts,
              ElementsAre(AllOf(HasSubstr("not used"), HasSubstr("timestamps.txt:1"))));
  // As many lines as the names count to: each scan has its own.
  WriteScans("part/lidar", {"000001.bin", "000003.bin"});
  Write("part/times.txt", "0\n1\n2\n3\n");
  EXPECT_THAT(Stamps(*Open("part/lidar")), ElementsAre(1000000000, 3000000000));
}

TEST_F(ScanSourceTest, FoldersThatHoldTheScansAreNamed) {
  WriteScans("top/lidar", {"1.bin", "2.bin"});
  EXPECT_THAT(OpenError("top"), AllOf(HasSubstr("holds no scans"),
                                      HasSubstr(Path("top/lidar") + " holds 2: give that one")));
}

TEST_F(ScanSourceTest, MissingFolder) {
  EXPECT_THAT(OpenError("none"), AllOf(HasSubstr("none"), HasSubstr("No such file")));
}

TEST_F(ScanSourceTest, EmptyFolder) {
  fs::create_directories(Path("empty/velodyne"));
  fs::create_directories(Path("raw/velodyne_points/data"));
  EXPECT_THAT(OpenError("empty"), HasSubstr("velodyne: holds no scans"));
  EXPECT_THAT(OpenError("empty/velodyne"), HasSubstr("holds no scans"));
  EXPECT_THAT(OpenError("raw"), HasSubstr("*.txt"));
}

TEST_F(ScanSourceTest, ASingleScan) {
  WriteScans("s", {"a.bin", "1700000000123456789.bin", "c.bin"});
  Write("s/times.txt", "1\n2\n3\n");
  Write("times.txt", "7\n");
  const auto scan = Open("s/c.bin");
  ASSERT_EQ(scan->size(), 1U);
  EXPECT_EQ(scan->Read(0).points[0].x, 2.0F);
  EXPECT_EQ(scan->Name(0), Path("s/c.bin"));
  // Lines of a file tell nothing of one scan out of many.
  EXPECT_FALSE(scan->recorded_stamps());
  EXPECT_THAT(scan->Describe().scans, HasSubstr("1 file *.bin"));
  EXPECT_THAT(scan->Describe().doubts, testing::IsEmpty());
  EXPECT_THAT(Stamps(*Open("s/1700000000123456789.bin")), ElementsAre(1700000000123456789));
  Write("a.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n");
  Write("b.pcd",
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\n"
        "HEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3\n");
  Write("c.txt", "1 2 3 0.5\n");
  for (const char* name : {"a.ply", "b.pcd", "c.txt"}) {
    EXPECT_EQ(Open(name)->Read(0).points[0].y, 2.0F) << name;
  }
  options_.topic = "/points";
  EXPECT_THAT(OpenError("a.ply"), HasSubstr("there is no topic '/points'"));
}

TEST_F(ScanSourceTest, FilesThatAreNoScansByTheirNameAreRefused) {
  Write("a.doc", "text");
  EXPECT_THAT(OpenError("a.doc"), AllOf(HasSubstr("a.doc"), HasSubstr("no scan by its name"),
                                        HasSubstr(".laz"), HasSubstr("MCAP")));
}

TEST_F(ScanSourceTest, UnreadableFolder) {
  if (geteuid() == 0) GTEST_SKIP() << "root may read anything";
  WriteScans("s", {"a.bin"});
  fs::permissions(Path("s"), fs::perms::none);
  const std::string message = OpenError("s");
  fs::permissions(Path("s"), fs::perms::owner_all);
  EXPECT_THAT(message, HasSubstr("Permission denied"));
}

TEST_F(ScanSourceTest, ScanThatVanishedIsNamedWhenRead) {
  WriteScans("s", {"a.bin", "b.bin"});
  const auto source = Open("s");
  fs::remove(Path("s/b.bin"));
  EXPECT_NO_THROW(source->Read(0));
  EXPECT_THAT(MessageOf<InputError>([&] { source->Read(1); }), HasSubstr("b.bin"));
}

TEST_F(ScanSourceTest, FewerStampsThanScans) {
  WriteScans("00/velodyne", {"0.bin", "1.bin", "2.bin"});
  Write("00/times.txt", "0\n0.1\n");
  EXPECT_THAT(OpenError("00"),
              AllOf(HasSubstr("times.txt:2:"), HasSubstr("2 stamps"), HasSubstr("3 scans")));
}

TEST_F(ScanSourceTest, StampsThatAreNoneAreNamed) {
  WriteScans("00/velodyne", {"0.bin", "1.bin"});
  for (const char* bad : {"0,1", "zero", "nan", "1 2", "1e-", "1e40", ".", "-",
                          "2011-13-26 13:02:25.5", "2011-02-30 13:02:25.5", "2011-09-26 24:02:25.5",
                          "2011-09-26 13:02:", "2011-09-26 13:02:-5", "2011-09-26 13:02:61.5"}) {
    Write("00/times.txt", std::string("0\n") + bad + "\n");
    EXPECT_THAT(OpenError("00"), HasSubstr("times.txt:2:")) << bad;
  }
}

TEST_F(ScanSourceTest, DamagedCalibrationIsNamed) {
  WriteScans("00/velodyne", {"0.bin"});
  for (const char* bad :
       {"Tr: 1 2 3", "Tr: 1 0 0 0 0 1 0 0 0 0 x 0", "Tr:", "Tr: 2 0 0 0 0 2 0 0 0 0 2 0"}) {
    Write("00/calib.txt", std::string("P0: 1\n") + bad + "\n");
    EXPECT_THAT(OpenError("00"), HasSubstr("calib.txt:2:")) << bad;
  }
}

TEST_F(ScanSourceTest, OptionsAreChecked) {
  WriteScans("s", {"a.bin"});
  options_.frame_period_s = 0.0;
  EXPECT_THAT(MessageOf<OptionError>([&] { Open("s"); }), HasSubstr("frame_period_s"));
}

}  // namespace
}  // namespace lamina
