// Scans of a corridor as files, and sessions that map them: for tests of backend/session/session.h.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "backend/session/checkpoint.h"
#include "backend/session/session.h"
#include "io/store/checkpoint_file.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

// Options that make much happen within few scans.
inline MappingOptions SmallMapping() {
  MappingOptions options;
  options.loops.enabled = false;
  options.preparation.min_range_m = 0.5;
  options.preparation.max_range_m = 6.0;
  options.mapper.map.root_size_m = 0.8;
  options.mapper.backend.window.frames = 5;
  options.mapper.backend.solve_every_keyframes = 3;
  options.mapper.backend.hand_over_lag_frames = 2;
  return options;
}

// A corridor with walls across on both sides, seen from within.
class Corridor {
 public:
  explicit Corridor(double length_m) {
    Draws draws(1);
    const double half = 0.5 * length_m;
    const Eigen::Vector3d along(half, 0, 0), up(0, 0, 1.5);
    const Eigen::Vector3d middle(half - 6.0, 0, 0);
    facets_ = {{middle + Eigen::Vector3d(0, 2.1, 0), along, up},
               {middle + Eigen::Vector3d(0, -1.9, 0), along, up},
               {middle + Eigen::Vector3d(0, 0, -1.4), along, {0, 2, 0}}};
    for (double x = -5.0; x < length_m - 6.0; x += draws.Uniform(0.8, 2.0)) {
      const double side = draws.Integer(0, 1) == 0 ? 1.6 : -1.4;
      facets_.push_back({{x, side, 0}, {0, 0.5, 0}, up});
    }
  }

  // The bytes of a KITTI .bin file, noise and choice of points by the seed.
  std::string Scan(const SE3& T_world_lidar, unsigned seed) const {
    constexpr double kPointsPerM2 = 15.0, kRangeM = 6.0, kSigmaM = 0.005;
    Draws draws(seed);
    const SE3 T_lidar_world = T_world_lidar.Inverse();
    std::vector<ScanPoint> points;
    for (const Facet& f : facets_) {
      const double area = 4.0 * f.edge1.norm() * f.edge2.norm();
      for (int i = 0; i < static_cast<int>(kPointsPerM2 * area); ++i) {
        const Eigen::Vector3d at =
            f.centre + draws.Uniform(-1.0, 1.0) * f.edge1 + draws.Uniform(-1.0, 1.0) * f.edge2;
        if (Hidden(at, T_world_lidar.t, facets_)) continue;
        const Eigen::Vector3d p =
            T_lidar_world * at +
            Eigen::Vector3d(draws.Normal(kSigmaM), draws.Normal(kSigmaM), draws.Normal(kSigmaM));
        if (p.norm() > kRangeM) continue;
        points.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()),
                          static_cast<float>(p.z()), 0.0F});
      }
    }
    return KittiBin(points);
  }

  // There and back again, half the length of the way at most 0.7 m a scan, slowly swinging.
  static SE3 PoseAt(int scan, int scans, double reach_m) {
    const double phase = 2.0 * M_PI * scan / scans;
    return SE3(ExpSO3({0.0, 0.0, 0.1 * std::sin(phase)}),
               {0.5 * reach_m * (1.0 - std::cos(phase)), 0.3 * std::sin(phase), 0.0});
  }

 private:
  std::vector<Facet> facets_;
};

// What an inbox would hand out, and where the files are.
struct Recording {
  std::vector<InboxFile> files;
  std::vector<SE3> truth;
  ScanSourceOptions options;

  StreamedScans From(std::int64_t next) const {
    StreamedScans scans(0, options);
    for (std::size_t i = 0; i < static_cast<std::size_t>(next); ++i) scans.Append(files[i]);
    return scans;
  }
};

class SessionTest : public FilesTest {
 protected:
  struct Scene {
    int scans = 24;
    double reach_m = 4.0;
    std::set<int> unreadable;
    // The first scan of the second sequence; its stamps begin anew.
    int second_sequence = 1000;
    unsigned seed = 1;
  };
  Recording Record(const Scene& scene, const std::string& folder = "inbox") const {
    const Corridor corridor(scene.reach_m + 12.0);
    Recording recording;
    for (int i = 0; i < scene.scans; ++i) {
      InboxFile file;
      const int number = i < scene.second_sequence ? i : i - scene.second_sequence;
      file.sequence = i < scene.second_sequence ? "" : "second";
      file.name = (file.sequence.empty() ? "" : file.sequence + "/") + "scan" +
                  std::to_string(1000 + number) + ".bin";
      file.stamp_ns = MadeUpStamp(static_cast<std::size_t>(number), {});
      if (number == 0) file.next_stamp_ns = MadeUpStamp(1, {});
      recording.truth.push_back(Corridor::PoseAt(i, scene.scans, scene.reach_m));
      const bool bad = scene.unreadable.count(i) > 0;
      file.path =
          Write(folder + "/" + file.name,
                bad ? "no points"
                    : corridor.Scan(recording.truth.back(), 1000 * scene.seed + unsigned(i)));
      recording.files.push_back(file);
    }
    return recording;
  }

  SessionSetup Setup(const std::string& folder) const {
    SessionSetup setup;
    setup.folder = Path(folder);
    setup.mapping = mapping_;
    setup.fixed_options = "first: 1\nsecond: 2\n";
    setup.session.checkpoint_every_scans = 5;
    setup.session.trajectory_period_s = 1e6;  // at the first scan and at the end
    return setup;
  }

  enum class Leave { kAtOnce, kWhenDone };
  // Maps up to scan `end`, all at once as it were, and leaves without Finish().
  void MapUntil(const SessionSetup& setup, const Recording& recording, std::int64_t end,
                Leave leave = Leave::kAtOnce) const {
    Session session(setup, {});
    Map(&session, recording, end);
    if (leave == Leave::kAtOnce) return;
    do {
      session.WaitForHousekeeping();
    } while (session.Idle());
    session.WaitForHousekeeping();
  }
  static void Map(Session* session, const Recording& recording, std::int64_t end) {
    StreamedScans scans = recording.From(session->next_scan());
    for (auto i = session->next_scan(); i < end; ++i) {
      scans.Append(recording.files[static_cast<std::size_t>(i)]);
    }
    session->Process(&scans, nullptr);
  }

  // What a session has come to, to the last bit.
  struct Result {
    std::string poses, map, tiles, kitti, tum;
    std::string records;  // of the map, out of the last checkpoint
    std::string solves;   // in the database: before which scan, of how much
  };
  // Maps what is left, and ends.
  Result FinishSession(const SessionSetup& setup, const Recording& recording) const {
    Result result;
    const auto end = static_cast<std::int64_t>(recording.files.size());
    {
      Session session(setup, {});
      Map(&session, recording, end);
      session.Finish();
      session.ForEachPose([&](const FinalPose& pose) { result.poses += BytesOf(pose); });
      result.map = BytesOf(session.mapping().map());
    }
    TileStore tiles(setup.folder + "/map_tiles.db", TileStore::Lifetime::kKept);
    tiles.ShowAll([&](std::string_view record) { result.tiles += record; });
    SQLite::Database database(setup.folder + "/session.db");
    SQLite::Statement solves(
        database, "SELECT before_scan || ' ' || planes || ' ' || iterations FROM solves");
    while (solves.executeStep()) result.solves += solves.getColumn(0).getString() + "\n";
    result.kitti = Bytes(setup.folder + "/trajectory_kitti.txt");
    result.tum = Bytes(setup.folder + "/trajectory_tum.txt");
    CheckpointReader reader(setup.folder + "/" + CheckpointName(end));
    std::string tag, bytes;
    while (reader.Next(&tag, &bytes)) {
      if (tag == "MAPC" || tag == "ROOT") result.records += bytes;
    }
    EXPECT_GT(result.records.size(), 10000U);
    return result;
  }
  static void ExpectSame(const Result& is, const Result& should) {
    EXPECT_EQ(is.kitti, should.kitti);
    EXPECT_EQ(is.solves, should.solves);
    EXPECT_TRUE(is.poses == should.poses) << "poses differ";
    EXPECT_TRUE(is.tum == should.tum) << "TUM trajectories differ";
    EXPECT_TRUE(is.map == should.map) << "surfaces differ";
    EXPECT_TRUE(is.tiles == should.tiles) << "records on disk differ";
    EXPECT_TRUE(is.records == should.records) << "records of the map differ";
  }

  static std::string BytesOf(FinalPose pose) {
    StateArchive a;
    a(&pose.scan, &pose.pose, &pose.skipped);
    return a.written();
  }
  static std::string BytesOf(const VoxelMap& map) {
    StateArchive a;
    map.ForEachSurface(
        1, [&](Surfel s) { a(&s.centre, &s.normal, &s.eigenvalues, &s.count, &s.last_keyframe); });
    return a.written();
  }
  // Every file of a folder.
  std::map<std::string, std::string> FilesOf(const std::string& folder) const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(Path(folder))) {
      files[entry.path().filename().string()] = Bytes(entry.path().string());
    }
    return files;
  }
  // Changes every tenth byte of the second half of a file.
  static void Damage(const std::string& path) {
    std::string bytes = Bytes(path);
    ASSERT_GT(bytes.size(), 100U) << path;
    for (std::size_t i = bytes.size() / 2; i < bytes.size(); i += 10) {
      bytes[i] = static_cast<char>(bytes[i] ^ 0x55);
    }
    std::ofstream(path, std::ios::binary) << bytes;
  }

  MappingOptions mapping_ = SmallMapping();
};

}  // namespace lamina
