// Folders as other people have them: each kind of names, fields, types, units and layouts becomes a
// recording that is understood, tracked and mapped without an option.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/files/foreign_points.h"
#include "tests/support/program/run_helpers.h"
#include "tests/support/scenes/swept_drive.h"

namespace lamina {
namespace {

using foreign::Constant;
using foreign::Field;
using foreign::Pcd;
using foreign::Ply;
using foreign::Time;
using foreign::With;
using foreign::Xyz;
using testing::AllOf;
using testing::HasSubstr;

constexpr std::size_t kSweeps = 10;
constexpr StampNs kEpochNs = 1'700'000'000'123'456'789;

const SweptDrive& ShortDrive(bool compensated) {
  static const SweptDrive swept(kSweeps, false), still(kSweeps, true);
  return compensated ? still : swept;
}

StampNs EpochStamp(std::size_t i) { return kEpochNs + 100'000'000LL * static_cast<StampNs>(i); }

// Readings of a clock that tells the Unix epoch.
Field Clock(const std::string& name, char type, std::size_t size, long double per_second,
            std::size_t scan) {
  return {name, type, size, [=](const Scan& s, std::size_t i) {
            return (static_cast<long double>(EpochStamp(scan)) * 1e-9L +
                    static_cast<long double>(s.time_s[i])) *
                   per_second;
          }};
}

// Cells without a return between the others, as an organised cloud has them.
Scan Organised(const Scan& scan, std::size_t height, float empty) {
  Scan organised = scan;
  organised.points.clear();
  organised.time_s.clear();
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    organised.points.push_back(scan.points[i]);
    organised.time_s.push_back(scan.time_s[i]);
    if (i % 7 == 0) {
      organised.points.push_back({empty, empty, empty, 0.0F});
      organised.time_s.push_back(scan.time_s[i]);
    }
  }
  while (organised.points.size() % height != 0) {
    organised.points.push_back({empty, empty, empty, 0.0F});
    organised.time_s.push_back(0.0F);
  }
  return organised;
}

// Where a recording begins to differ from others: its files, and what a run has to say of them.
struct Kind {
  std::string name;
  bool compensated;
  // Name and bytes of the file of scan i.
  std::function<std::pair<std::string, std::string>(const Scan&, std::size_t)> file;
  std::string understood;  // in the opening lines
};

std::string Number(std::size_t i, int digits) {
  const std::string number = std::to_string(i);
  const auto width = static_cast<std::size_t>(digits);
  return number.size() < width ? std::string(width - number.size(), '0') + number : number;
}

std::string Seconds(StampNs stamp_ns) {
  const std::string digits = std::to_string(stamp_ns);
  return digits.substr(0, digits.size() - 9) + "." + digits.substr(digits.size() - 9);
}

using Named = std::pair<std::string, std::string>;

std::vector<Kind> KindsWithoutTimes() {
  const Field intensity = Constant("intensity", 'F', 4, 7.0);
  return {
      {"bin_numbered", true,
       [](const Scan& s, std::size_t i) {
         return Named("velodyne/" + Number(i, 10) + ".bin", KittiBin(s.points));
       },
       "10 files *.bin"},
      {"pcd_ascii_xyz", true,
       [](const Scan& s, std::size_t i) {
         return Named("cloud_" + std::to_string(i) + ".pcd", Pcd(s, Xyz(), true));
       },
       "10 files *.pcd"},
      {"pcd_names_in_seconds", true,
       [=](const Scan& s, std::size_t i) {
         return Named(Seconds(EpochStamp(i)) + ".pcd", Pcd(s, With(Xyz(), {intensity})));
       },
       "stamps from"},
      {"pcd_names_in_nanoseconds", true,
       [](const Scan& s, std::size_t i) {
         return Named(std::to_string(EpochStamp(i)) + ".pcd", Pcd(s, Xyz()));
       },
       "stamps from"},
      {"pcd_organised_with_nan", true,
       [=](const Scan& s, std::size_t i) {
         const float nan = std::numeric_limits<float>::quiet_NaN();
         return Named(
             Number(i, 6) + ".pcd",
             Pcd(Organised(s, 16, nan), With(Xyz(), {Constant("label", 'U', 4, 40)}), false, 16));
       },
       "10 files *.pcd"},
      {"carla_ply_ascii", true,
       [](const Scan& s, std::size_t i) {
         return Named(Number(4711 + i, 8) + ".ply",
                      Ply(s, With(Xyz(), {Constant("I", 'F', 4, 0.9)}), "ascii"));
       },
       "10 files *.ply"},
      {"open3d_ply_double", true,
       [](const Scan& s, std::size_t i) {
         const std::vector<Field> fields =
             With(Xyz(8), {Constant("nx", 'F', 8, 0), Constant("ny", 'F', 8, 0),
                           Constant("nz", 'F', 8, 1), Constant("red", 'U', 1, 10),
                           Constant("green", 'U', 1, 20), Constant("blue", 'U', 1, 30)});
         return Named("fragment_" + Number(i, 3) + ".ply", Ply(s, fields, "binary_little_endian"));
       },
       "10 files *.ply"},
      {"ply_big_endian", true,
       [](const Scan& s, std::size_t i) {
         return Named(std::to_string(i) + ".ply", Ply(s, Xyz(), "binary_big_endian"));
       },
       "10 files *.ply"},
  };
}

std::vector<Kind> KindsWithTimes() {
  const Field ring = Constant("ring", 'U', 2, 3);
  return {
      {"ouster_pcd", false,
       [=](const Scan& s, std::size_t i) {
         return Named(
             std::to_string(EpochStamp(i)) + ".pcd",
             Pcd(Organised(s, 16, 0.0F),
                 With(Xyz(), {Time("t", 'U', 4, 1e9L), ring, Constant("range", 'U', 4, 0)}), false,
                 16));
       },
       "times in field 't' in ns"},
      {"velodyne_pcd_end_of_sweep", false,
       [=](const Scan& s, std::size_t i) {
         Scan late = s;
         for (float& t : late.time_s) t -= 0.05F;
         return Named(Seconds(EpochStamp(i) + 50'000'000) + ".pcd",
                      Pcd(late, With(Xyz(), {ring, Time("time", 'F', 4, 1.0L)})));
       },
       "times in field 'time' in s"},
      {"hesai_pcd_clock", false,
       [=](const Scan& s, std::size_t i) {
         return Named(std::to_string(i + 1) + ".pcd",
                      Pcd(s, With(Xyz(), {Clock("timestamp", 'F', 8, 1.0L, i), ring})));
       },
       "readings of a clock"},
      {"robosense_pcd_clock_out_of_order", false,
       [=](const Scan& s, std::size_t i) {
         return Named(std::to_string(1 + (i ^ 1U)) + ".pcd",
                      Pcd(s, With(Xyz(), {Clock("timestamp", 'F', 8, 1.0L, i)})));
       },
       "in the order of their stamps"},
      {"apollo_pcd_compensated_clock", true,
       [=](const Scan& s, std::size_t i) {
         return Named(std::to_string(i + 1) + ".pcd",
                      Pcd(s, With(Xyz(), {Constant("intensity", 'U', 1, 9),
                                          Clock("timestamp", 'F', 8, 1.0L, i)})));
       },
       "readings of a clock"},
      {"livox_ply_offsets", false,
       [=](const Scan& s, std::size_t i) {
         return Named(
             std::to_string(EpochStamp(i)) + ".ply",
             Ply(s,
                 With(Xyz(), {Time("offset_time", 'U', 4, 1e9L),
                              Constant("reflectivity", 'U', 1, 9), Constant("line", 'U', 1, 2)}),
                 "binary_little_endian"));
       },
       "times in field 'offset_time' in ns"},
      {"nanoseconds_of_a_clock", false,
       [=](const Scan& s, std::size_t i) {
         return Named(Number(i, 4) + ".pcd", Pcd(s, With(Xyz(), {Clock("t", 'U', 8, 1e9L, i)})));
       },
       "readings of a clock"},
      {"cloudcompare_ply", false,
       [=](const Scan& s, std::size_t i) {
         return Named(Seconds(EpochStamp(i)) + ".ply",
                      Ply(s,
                          With(Xyz(), {Constant("scalar_Intensity", 'F', 4, 3),
                                       Time("scalar_Time", 'F', 4, 1e3L)}),
                          "binary_little_endian"));
       },
       "in ms"},
  };
}

class FolderKindTest : public RunTest {
 protected:
  // Runs on the folder and holds poses and map against the drive's truth.
  void ExpectTracked(const std::string& scans, const std::string& understood, bool compensated) {
    const Outcome outcome = Run(scans);
    EXPECT_THAT(outcome.err, HasSubstr(understood));
    const nlohmann::json summary = Summary();
    EXPECT_EQ(summary["lost_frames"], 0);
    EXPECT_GT(summary["map_surfels"], 100);
    const Trajectory poses = ReadTrajectory(Path("out/trajectory_tum.txt"));
    ASSERT_EQ(poses.size(), kSweeps);
    const SweptDrive& drive = ShortDrive(compensated);
    for (std::size_t i = 0; i < kSweeps; ++i) {
      const SE3 truth = drive.TruePose(0).Inverse() * drive.TruePose(i);
      EXPECT_LT((poses[i].T_world_lidar.t - truth.t).norm(), 0.1) << "scan " << i;
    }
  }
};

class EveryFolderKind : public FolderKindTest, public testing::WithParamInterface<Kind> {};

TEST_P(EveryFolderKind, IsUnderstoodTrackedAndMapped) {
  const Kind& kind = GetParam();
  for (std::size_t i = 0; i < kSweeps; ++i) {
    const auto [name, bytes] = kind.file(ShortDrive(kind.compensated).Read(i), i);
    Write("scans/" + name, bytes);
  }
  ExpectTracked(Path("scans"), kind.understood, kind.compensated);
}

std::string NameOfKind(const testing::TestParamInfo<Kind>& info) { return info.param.name; }
INSTANTIATE_TEST_SUITE_P(WithoutTimes, EveryFolderKind, testing::ValuesIn(KindsWithoutTimes()),
                         NameOfKind);
INSTANTIATE_TEST_SUITE_P(WithTimes, EveryFolderKind, testing::ValuesIn(KindsWithTimes()),
                         NameOfKind);

TEST_F(FolderKindTest, ForeignFilesBesideTheScansAreNoScans) {
  for (std::size_t i = 0; i < kSweeps; ++i) {
    Write("scans/" + Number(i, 6) + ".bin", KittiBin(ShortDrive(true).Read(i).points));
  }
  for (const char* name : {".DS_Store", "Thumbs.db", "readme.txt", "labels.json", "000003.bin.swp",
                           ".000004.bin.part", "000005.png"}) {
    Write(std::string("scans/") + name, "not a scan");
  }
  ExpectTracked(Path("scans"), "10 files *.bin", true);
}

TEST_F(FolderKindTest, StampsStandInTheFolderAbove) {
  std::string times;
  for (std::size_t i = 0; i < kSweeps; ++i) {
    Write("drive/clouds/" + std::to_string(i) + ".pcd", Pcd(ShortDrive(true).Read(i), Xyz()));
    times += Seconds(EpochStamp(i)) + "\n";
  }
  Write("drive/times.txt", times);
  ExpectTracked(Path("drive/clouds"), "times.txt", true);
  EXPECT_EQ(ReadTrajectory(Path("out/trajectory_tum.txt")).front().stamp_ns, EpochStamp(0));
}

TEST_F(FolderKindTest, KeyframesSomeMetresApartAreTrackedFromTheFirstPairOn) {
  // Every third scan, 3 m further: as if picked by way.
  for (std::size_t i = 0; i < kSweeps; i += 3) {
    Write("scans/" + Seconds(EpochStamp(i)) + ".pcd", Pcd(ShortDrive(true).Read(i), Xyz()));
  }
  Run(Path("scans"));
  EXPECT_EQ(Summary()["lost_frames"], 0);
  const Trajectory poses = ReadTrajectory(Path("out/trajectory_tum.txt"));
  ASSERT_EQ(poses.size(), 4U);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const SE3 truth = ShortDrive(true).TruePose(0).Inverse() * ShortDrive(true).TruePose(3 * k);
    EXPECT_LT((poses[k].T_world_lidar.t - truth.t).norm(), 0.1) << k;
  }
}

TEST_F(FolderKindTest, ATripodAndASingleScanMakeMaps) {
  for (std::size_t i = 0; i < kSweeps; ++i) {
    Write("tripod/" + Number(i, 3) + ".bin", KittiBin(ShortDrive(true).Read(0).points));
  }
  Run(Path("tripod"), {}, 0, "tripod_out");
  EXPECT_GT(Summary("tripod_out")["map_surfels"], 100);
  Write("single/scan.pcd", Pcd(ShortDrive(true).Read(0), Xyz()));
  Run(Path("single"), {}, 0, "single_out");
  EXPECT_GT(Summary("single_out")["map_surfels"], 100);
  EXPECT_EQ(Lamina({"plot", "--run", Path("single_out")}).code, 0);
}

TEST_F(FolderKindTest, DamagedFilesInTheMiddleCostThemselvesAlone) {
  for (std::size_t i = 0; i < kSweeps; ++i) {
    std::string bytes = Pcd(ShortDrive(true).Read(i), Xyz());
    if (i == 4) bytes.resize(bytes.size() / 2);
    if (i == 7) bytes.clear();
    Write("scans/" + std::to_string(EpochStamp(i)) + ".pcd", bytes);
  }
  const Outcome outcome = Run(Path("scans"));
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("skipped scan 4"), HasSubstr("skipped scan 7")));
  EXPECT_EQ(Summary()["skipped_scans"], 2);
  EXPECT_EQ(Summary()["lost_frames"], 0);
}

TEST_F(FolderKindTest, ScansOneFolderDownAreNamed) {
  Write("data/lidar/a/000000.bin", KittiBin(ShortDrive(true).Read(0).points));
  const Outcome outcome = Run(Path("data/lidar"), {}, 1);
  EXPECT_THAT(outcome.err, HasSubstr(Path("data/lidar/a")));
}

}  // namespace
}  // namespace lamina
