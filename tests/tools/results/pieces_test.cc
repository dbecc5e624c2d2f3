// Two recordings in one inbox are two pieces of a map, in every file, in the answers of the daemon
// and on the pages.
#include <httplib.h>
#undef _res  // a macro of <resolv.h>; Eigen has variables of that name

#include "io/map/map_io.h"
#include "tests/support/program/browser.h"
#include "tests/support/program/watch_scenes.h"
#include "tests/support/scenes/live_world.h"
#include "tools/report/data.h"
#include "tools/results/verdict/process_report.h"
#include "tools/watch/live/map_queries.h"
#include "tools/watch/live/server.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;

class PiecesFilesTest : public WatchTest {
 protected:
  // A column of frames.csv.
  std::vector<std::string> Column(const std::string& folder, const std::string& name) const {
    const auto cells = [](const std::string& line) {
      std::vector<std::string> list;
      std::istringstream stream(line);
      for (std::string cell; std::getline(stream, cell, ',');) list.push_back(cell);
      return list;
    };
    const std::vector<std::string> lines = Lines(Bytes(Path(folder + "/frames.csv")));
    const std::vector<std::string> names = cells(lines.at(0));
    const auto at = std::find(names.begin(), names.end(), name) - names.begin();
    std::vector<std::string> column;
    for (std::size_t i = 1; i < lines.size(); ++i) {
      column.push_back(cells(lines[i]).at(static_cast<std::size_t>(at)));
    }
    return column;
  }
  // The poses of one piece, as lines of the KITTI trajectory.
  std::vector<std::string> PosesOf(const std::string& folder, const std::string& piece) const {
    const std::vector<std::string> pieces = Column(folder, "piece");
    const std::vector<std::string> all = Lines(Bytes(Path(folder + "/trajectory_kitti.txt")));
    EXPECT_EQ(all.size(), pieces.size());
    std::vector<std::string> lines;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (pieces.at(i) == piece) lines.push_back(all[i]);
    }
    return lines;
  }
};

TEST_F(PiecesFilesTest, TwoFoldersAreTwoPiecesAndEachIsWhatRunMakesOfIt) {
  const Recording street = Street(24);
  const Recording room = SyntheticRecording(synth::SceneKind::kRoom, 10, 1);
  WriteRecording("in/a", street);
  WriteRecording("in/b", room);
  Write("session/map_surfels_piece7.ply", "of an earlier run");
  Once();
  Run(Path("in/a"), {}, 0, "a");
  // Of itself it would map a room finer.
  Run(Path("in/b"), {"--config", "default"}, 0, "b");
  EXPECT_EQ(PosesOf("session", "0"), Lines(Bytes(Path("a/trajectory_kitti.txt"))));
  EXPECT_EQ(PosesOf("session", "1"), Lines(Bytes(Path("b/trajectory_kitti.txt"))));
  EXPECT_TRUE(Bytes(Path("session/map_surfels.ply")) == Bytes(Path("a/map_surfels.ply")));
  EXPECT_TRUE(Bytes(Path("session/map_surfels_piece1.ply")) == Bytes(Path("b/map_surfels.ply")));
  EXPECT_FALSE(fs::exists(Path("session/map_surfels_piece7.ply")));
  const nlohmann::json pieces = Summary("session")["pieces"];
  ASSERT_EQ(pieces.size(), 2U);
  EXPECT_EQ(pieces[0]["frames"], 24);
  EXPECT_EQ(pieces[1]["frames"], 10);
  EXPECT_EQ(pieces[0]["recording"], "a/velodyne");
  EXPECT_EQ(pieces[1]["recording"], "b/velodyne");
  EXPECT_EQ(pieces[0]["connected_to"], nlohmann::json::array());
  EXPECT_EQ(Summary("a")["pieces"].size(), 1U);
  // The report shows each on its own.
  ReportSource source;
  source.folder = Path("session");
  const nlohmann::json data = ReadReportData(source);
  ASSERT_EQ(data["further_maps"].size(), 1U);
  EXPECT_EQ(data["further_maps"][0]["piece"], 1);
  EXPECT_GT(data["further_maps"][0]["surfels"], 50);
  source.folder = Path("a");
  EXPECT_THAT(ReadReportData(source)["further_maps"], IsEmpty());
}

// A recording that is in another place from its middle on.
TEST_F(PiecesFilesTest, ARestartIsAPieceThatIsNotConnected) {
  Recording cut = Street(10);
  const Recording room = SyntheticRecording(synth::SceneKind::kRoom, 12, 1);
  cut.insert(cut.end(), room.begin(), room.end());
  for (std::size_t i = 0; i < cut.size(); ++i) cut[i].stamp_s = 0.1 * static_cast<double>(i);
  const Outcome outcome =
      Run(WriteRecording("cut", cut), {"--set", "backend.restart_after_lost_frames=2"});
  EXPECT_THAT(outcome.err, HasSubstr("begins piece 1 of the map"));
  EXPECT_THAT(outcome.out, HasSubstr("2 pieces that are not connected"));
  EXPECT_EQ(Summary()["restarts"], 1);
  const nlohmann::json pieces = Summary()["pieces"];
  ASSERT_EQ(pieces.size(), 2U);
  EXPECT_EQ(pieces[1]["first_scan"], 12);
  EXPECT_EQ(pieces[1]["last_scan"], 21);
  EXPECT_EQ(pieces[0]["lost_frames"], 2);
  EXPECT_EQ(Column("out", "status").at(12), "first");
  EXPECT_TRUE(fs::exists(Path("out/map_surfels_piece1.ply")));
}

// The truth of the second piece lies elsewhere than its frame says: all in one would be far off.
TEST_F(PiecesFilesTest, EachPieceHasATrajectoryAndIsJudgedByItself) {
  Recording cut = Street(10);
  const Recording room = SyntheticRecording(synth::SceneKind::kRoom, 12, 1);
  cut.insert(cut.end(), room.begin(), room.end());
  for (std::size_t i = 0; i < cut.size(); ++i) cut[i].stamp_s = 0.1 * static_cast<double>(i);
  const std::string scans = WriteRecording("cut", cut);
  Write("out/trajectory_tum_piece9.txt", "of an earlier run");
  Run(scans, {"--set", "backend.restart_after_lost_frames=2"});
  EXPECT_FALSE(fs::exists(Path("out/trajectory_tum_piece9.txt")));
  const std::vector<std::string> all = Lines(Bytes(Path("out/trajectory_tum.txt")));
  std::vector<std::string> by_piece = Lines(Bytes(Path("out/trajectory_tum_piece0.txt")));
  const std::vector<std::string> second = Lines(Bytes(Path("out/trajectory_tum_piece1.txt")));
  EXPECT_EQ(second.size(), 10U);
  by_piece.insert(by_piece.end(), second.begin(), second.end());
  EXPECT_EQ(by_piece, all);

  const SE3 elsewhere(ExpSO3({0.0, 0.0, 1.0}), {300.0, 0.0, 0.0});
  Trajectory truth = ReadTrajectory(Path("out/trajectory_tum_piece0.txt"));
  for (StampedPose pose : ReadTrajectory(Path("out/trajectory_tum_piece1.txt"))) {
    pose.T_world_lidar = elsewhere * pose.T_world_lidar;
    truth.push_back(pose);
  }
  WriteTumTrajectory(Path("truth.txt"), truth);
  const Outcome outcome =
      Run(scans, {"--set", "backend.restart_after_lost_frames=2", "--truth", Path("truth.txt")});
  EXPECT_THAT(outcome.out, HasSubstr("piece 1 against the truth: APE 0.0000 m"));
  EXPECT_THAT(outcome.err, HasSubstr("removed map_surfels_piece1.ply, trajectory_tum_piece0.txt, "
                                     "trajectory_tum_piece1.txt"));
  EXPECT_FALSE(Summary().contains("ape_rmse_m"));
  EXPECT_EQ(Summary()["compared_with_truth"], "each piece by itself");
  for (const nlohmann::json& piece : Summary()["pieces"]) EXPECT_LT(piece["ape_rmse_m"], 1e-6);

  for (const std::string name : {"trajectory_tum.txt", "trajectory_kitti.txt"}) {
    SCOPED_TRACE(name);
    const Outcome eval = Lamina({"eval", "--estimate", Path("out/" + name), "--truth",
                                 Path("truth.txt"), "--scans", scans, "--json", Path("eval.json")});
    EXPECT_THAT(eval.out, HasSubstr("2 pieces that are not connected; each is judged by itself"));
    const nlohmann::json json = nlohmann::json::parse(Bytes(Path("eval.json")));
    ASSERT_EQ(json["truth"].size(), 2U);
    for (const nlohmann::json& piece : json["truth"]) EXPECT_LT(piece["ape_rmse_m"], 1e-6);
    EXPECT_EQ(json["map_quality"].size(), 2U);
  }
}

TEST_F(PiecesFilesTest, PiecesWithoutStampsAreJudgedByTheirLines) {
  Trajectory poses(20);
  for (int i = 0; i < 20; ++i) {
    poses[static_cast<std::size_t>(i)] = {i, LiveWorld::Frame(i).pose.T_world_lidar};
  }
  const SE3 elsewhere(ExpSO3({0.0, 0.0, 1.0}), {300.0, 0.0, 0.0});
  Trajectory truth = poses;
  std::string csv = "scan,status,piece,read_ms\n";
  for (std::size_t i = 0; i < poses.size(); ++i) {
    csv += std::to_string(i) + ",tracked," + (i < 12 ? "0,1\n" : "1,1\n");
    if (i >= 12) truth[i].T_world_lidar = elsewhere * truth[i].T_world_lidar;
  }
  Write("run/frames.csv", csv);
  WriteTumTrajectory(Path("run/trajectory_tum.txt"), poses);
  WriteKittiTrajectory(Path("run/trajectory_kitti.txt"), poses);
  WriteKittiTrajectory(Path("truth.txt"), truth);
  std::vector<std::string> eval{
      "eval",   "--estimate",     Path("run/trajectory_kitti.txt"), "--truth", Path("truth.txt"),
      "--json", Path("eval.json")};
  const auto judged = [&] {
    const Outcome outcome = Lamina(eval);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json json = nlohmann::json::parse(Bytes(Path("eval.json")));
    std::vector<int> counts;
    for (const nlohmann::json& piece : json["truth"]) {
      counts.push_back(piece.value("poses", 0));
      EXPECT_LT(piece.value("ape_rmse_m", 1.0), 1e-6);
    }
    return counts;
  };
  EXPECT_THAT(judged(), testing::ElementsAre(12, 8));
  // Of a part, too, which begins within the first piece.
  eval.insert(eval.end(), {"--frames", "5:18"});
  EXPECT_THAT(judged(), testing::ElementsAre(7, 6));
  ReportSource source;
  source.folder = Path("run");
  source.truth = Path("truth.txt");
  WriteSurfels(Path("run/map_surfels.ply"), {});
  EXPECT_LT(ReadReportData(source)["truth"]["figures"]["ape_rmse_m"], 1e-6);
  // A truth that is not of these scans is refused as a whole, whatever pieces would match.
  WriteKittiTrajectory(Path("truth.txt"), Trajectory(truth.begin(), truth.begin() + 12));
  eval.resize(eval.size() - 2);
  EXPECT_EQ(Lamina(eval).code, 1);
}

TEST_F(PiecesFilesTest, TheDaemonTellsPiecesApart) {
  const Recording street = Street(12);
  DropScans(street, 0, 6, "a/");
  const pid_t daemon = StartWatch({"--http", "127.0.0.1:0"});
  const std::string where = "live page at http://127.0.0.1:";
  ASSERT_TRUE(WaitUntil(daemon, [&] { return Said(where); }));
  const std::string said = Bytes(Path("stderr"));
  httplib::Client client("127.0.0.1", std::atoi(said.c_str() + said.find(where) + where.size()));
  const auto status = [&] { return nlohmann::json::parse(client.Get("/api/status")->body); };
  ASSERT_TRUE(WaitForScans(daemon, 6));
  DropScans(street, 0, 6, "b/");
  ASSERT_TRUE(WaitUntil(daemon, [&] {
    const nlohmann::json s = status();
    return s["state"] == "idle" && s["frames"] == 12 && s["last_pose"]["index"] == 11;
  }));
  EXPECT_EQ(status()["pieces"], 2);
  EXPECT_EQ(status()["last_pose"]["piece"], 1);
  const auto surfels = [&](int piece) {
    const auto map = client.Get(
        ("/api/map?x=0&y=0&z=0&radius=60&page=0&piece=" + std::to_string(piece)).c_str());
    std::uint32_t count = 0;
    if (map && map->status == 200) std::memcpy(&count, map->body.data() + 32, sizeof(count));
    return count;
  };
  EXPECT_GT(surfels(0), 50U);
  EXPECT_EQ(surfels(1), surfels(0));  // the same scans
  EXPECT_EQ(surfels(2), 0U);
  Terminate(daemon);
}

// The page shows one piece at a time: the newest, until another is chosen.
TEST_F(PiecesFilesTest, ThePageShowsOnePieceAtATime) {
  if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  const LiveWorld first(60.0, 0.5), second(30.0, 0.5);
  LiveView view;
  HttpParts parts;
  parts.view = &view;
  parts.session = Path("");
  parts.map = [&](const MapQuery& query) {
    return (query.piece == 0 ? first : second).Answer(query);
  };
  parts.checkpoint = parts.stop = [] {};
  const HttpServer server(HttpAddress{"127.0.0.1", 0}, parts);
  const auto add = [&](std::int64_t i, std::int64_t piece) {
    LiveFrame frame = LiveWorld::Frame(i);
    frame.pose.piece = piece;
    view.AddFrame(frame);
    LiveScan scan = LiveWorld::Scan(i);
    scan.piece = piece;
    view.SetScan(scan);
    view.SetStatus({});
  };
  for (int i = 0; i < 20; ++i) add(i, 0);
  Browser browser(Path("profile"), 900, 640);
  browser.Go(server.url());
  const auto surfels = [&](const LiveWorld& world) {
    return !browser.WaitFor("lamina.viewer.map.count === " + std::to_string(world.size()))
                .is_null();
  };
  ASSERT_TRUE(surfels(first));
  EXPECT_TRUE(browser.Run("return document.getElementById('piece').hidden"));
  for (int i = 20; i < 26; ++i) add(i, 1);
  EXPECT_TRUE(surfels(second));
  EXPECT_EQ(browser.Run("return lamina.state.piece"), 1);
  EXPECT_FALSE(browser.Run("return document.getElementById('piece').hidden"));
  EXPECT_NEAR(browser.Run("return parseFloat(document.getElementById('path-length').textContent)"),
              5.0, 1.0);
  EXPECT_FALSE(browser.WaitFor("lamina.viewer.scan.visible").is_null());
  browser.Run(
      "const list = document.getElementById('piece'); list.value = '0'; "
      "list.dispatchEvent(new Event('change'));");
  EXPECT_TRUE(surfels(first));
  for (int i = 26; i < 30; ++i) add(i, 1);
  EXPECT_FALSE(browser.WaitFor("lamina.state.poses.length === 30").is_null());
  EXPECT_EQ(browser.Run("return lamina.state.piece"), 0);
  EXPECT_FALSE(browser.WaitFor("!lamina.viewer.scan.visible").is_null());
  EXPECT_THAT(browser.Errors(), IsEmpty());
}

TEST_F(PiecesFilesTest, TheReportShowsOnePieceAtATime) {
  if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  fs::create_directories(Path("run"));
  std::size_t sizes[2] = {};
  for (const int piece : {0, 1}) {
    const LiveWorld world(piece == 0 ? 20.0 : 10.0, 0.5);
    SurfelMap map;
    for (const MapCell& cell : world.Answer({{10, 0, 0}, 1e4, 0, -1}).cells) {
      map.insert(map.end(), cell.surfels.begin(), cell.surfels.end());
    }
    sizes[piece] = map.size();
    WriteSurfels(Path("run/" + MapFileName(piece)), map);
  }
  Trajectory trajectory;
  std::string csv = "scan,status,piece,read_ms\n";
  for (int i = 0; i < 40; ++i) {
    const LivePose pose = LiveWorld::Frame(i).pose;
    csv += std::to_string(i) + (i == 7 ? ",unreadable," : ",tracked,") +
           std::to_string(i < 30 ? 0 : 1) + ",1\n";
    if (i != 7) trajectory.push_back({pose.stamp_ns, pose.T_world_lidar});
  }
  WriteTumTrajectory(Path("run/trajectory_tum.txt"), trajectory);
  Write("run/frames.csv", csv);
  ASSERT_EQ(Lamina({"report", "--run", Path("run"), "--out", Path("report.html")}).code, 0);
  Browser browser(Path("profile"), 900, 700);
  browser.Go("file://" + Path("report.html"));
  ASSERT_FALSE(browser.WaitFor("!!lamina.viewer").is_null());
  EXPECT_EQ(browser.Run("return lamina.viewer.map.count"), sizes[0]);
  EXPECT_EQ(browser.Run("return lamina.poses.filter((p) => p.piece === 1).length"), 10);
  browser.Run(
      "const list = document.getElementById('piece'); list.value = '1'; "
      "list.dispatchEvent(new Event('change'));");
  EXPECT_EQ(browser.Run("return lamina.viewer.map.count"), sizes[1]);
  EXPECT_THAT(browser.Errors(), IsEmpty());
  // The picture and the cloud hold what can be put together.
  const Outcome plot = Lamina({"plot", "--run", Path("run")});
  EXPECT_THAT(plot.err, HasSubstr("10 of 39 poses are of pieces"));
}

}  // namespace
}  // namespace lamina
