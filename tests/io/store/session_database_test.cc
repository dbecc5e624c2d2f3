#include "io/store/session_database.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <cmath>
#include <limits>

#include "tests/io/store/session_database_fixture.h"

namespace lamina {
namespace {

using testing::HasSubstr;

TEST_F(SessionDatabaseTest, EveryFieldComesBackToTheLastBit) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  std::vector<ScanRecord> rows = {FullRow(0, "a.bin"), ScanRow(1, "b.bin")};
  rows.push_back(FullRow(2, "c.bin"));
  rows[2].inlier_share = std::numeric_limits<double>::quiet_NaN();
  rows[2].residual_m = kInf;
  rows[2].worst_sigma_m = -kInf;
  rows[2].covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  rows[2].T_world_lidar.t = {kInf, std::nan(""), 1e-310};
  rows[2].T_world_lidar.q.coeffs() *= 1.0 + 1e-13;  // must not be normalised on the way
  rows[2].stamp_ns = std::numeric_limits<StampNs>::min();
  rows[2].next_stamp_ns = std::numeric_limits<StampNs>::max();
  rows[2].points = std::numeric_limits<std::int64_t>::max();
  {
    const auto database = Open();
    for (const ScanRecord& row : rows) database->Put(row);
  }
  const std::vector<ScanRecord> read = All(*Open());
  ASSERT_EQ(read.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(BytesOf(read[i]), BytesOf(rows[i])) << "row " << i;
  }
}

TEST_F(SessionDatabaseTest, NamesAreBytes) {
  const std::vector<std::string> names = {
      "plain.bin", "with space.bin", "new\nline.bin",        "quote'\".bin", "\xff\xfe invalid.bin",
      "\xc3\xa4",  "%s ? :a $b.bin", std::string(4096, 'x'), "PLAIN.bin",    "plain.bin "};
  const auto database = Open();
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_FALSE(database->Knows(names[i]));
    database->Put(ScanRow(static_cast<std::int64_t>(i), names[i], names[i]));
    EXPECT_TRUE(database->Knows(names[i]));
  }
  const std::vector<ScanRecord> rows = All(*Open());
  ASSERT_EQ(rows.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(rows[i].file, names[i]);
    EXPECT_EQ(rows[i].sequence, names[i]);
  }
  EXPECT_EQ(database->Sequences(100).size(), names.size());
}

TEST_F(SessionDatabaseTest, KnowsScansAndFilesSetAside) {
  const auto database = Open();
  EXPECT_FALSE(database->Knows(""));
  database->Put(ScanRow(0, "scan.bin"));
  database->SetAside("late\n\xff.bin", "it came late");
  database->SetAside("late\n\xff.bin", "again");
  EXPECT_TRUE(database->Knows("scan.bin"));
  EXPECT_TRUE(database->Knows("late\n\xff.bin"));
  EXPECT_FALSE(database->Knows("late"));
  EXPECT_FALSE(database->Knows("scan.bi"));
  EXPECT_EQ(database->scans(), 1);
  EXPECT_EQ(database->set_aside(), 1);
}

TEST_F(SessionDatabaseTest, AScanTakesThePlaceOfWhatWasKnownOfIt) {
  const auto database = Open();
  database->Put(ScanRow(0, "a"));
  database->Put(FullRow(0, "a"));
  ASSERT_EQ(All(*database).size(), 1U);
  EXPECT_EQ(BytesOf(All(*database)[0]), BytesOf(FullRow(0, "a")));
}

TEST_F(SessionDatabaseTest, ScansAreShownInOrderFromAndTo) {
  const auto database = Open();
  EXPECT_EQ(database->scans(), 0);
  for (const int i : {3, 0, 2, 1, 4}) database->Put(ScanRow(i, std::to_string(i)));
  EXPECT_EQ(database->scans(), 5);
  std::vector<std::int64_t> seen;
  database->ForEach(1, 4, [&](const ScanRecord& row) { seen.push_back(row.scan); });
  EXPECT_EQ(seen, (std::vector<std::int64_t>{1, 2, 3}));
  database->ForEach(5, 9, [&](const ScanRecord&) { ADD_FAILURE(); });
}

TEST_F(SessionDatabaseTest, AFinalPoseIsPutIntoItsRow) {
  const SE3 T = Draws(9).Pose(1.0);
  {
    const auto database = Open();
    for (int i = 0; i < 2; ++i) database->Put(ScanRow(i, std::to_string(i)));
    database->Finalise({1, T, false});
  }
  ScanRecord expected = ScanRow(1, "1");
  expected.T_world_lidar = T;
  expected.final = true;
  const std::vector<ScanRecord> rows = All(*Open());
  EXPECT_EQ(BytesOf(rows[0]), BytesOf(ScanRow(0, "0")));
  EXPECT_EQ(BytesOf(rows[1]), BytesOf(expected));
  EXPECT_THROW(Open()->Finalise({7, T, false}), std::logic_error);
}

TEST_F(SessionDatabaseTest, OfAStartThatWasGivenUpWhatWasTrackedIsDegenerate) {
  const auto database = Open();
  for (int i = 0; i < 3; ++i) {
    ScanRecord row = ScanRow(i, std::to_string(i));
    row.status = i == 1 ? "lost" : "tracked";
    row.unobservable_directions = 0;
    database->Put(row);
    database->Finalise({i, row.T_world_lidar, false, i < 2});
  }
  const std::vector<ScanRecord> rows = All(*database);
  EXPECT_EQ(rows[0].status, "degenerate");
  EXPECT_EQ(rows[0].unobservable_directions, 1);
  EXPECT_EQ(rows[1].status, "lost");
  EXPECT_EQ(rows[2].status, "tracked");
}

TEST_F(SessionDatabaseTest, APoseBetweenNeighboursDoesNotReplaceOneOfAScansOwn) {
  const auto database = Open();
  ScanRecord skipped = ScanRow(0, "0"), own = ScanRow(1, "1");
  skipped.skipped = true;
  database->Put(skipped);
  database->Put(own);
  const SE3 T = Draws(9).Pose(1.0);
  database->Finalise({0, T, true});
  database->Finalise({1, T, true});
  const std::vector<ScanRecord> rows = All(*database);
  EXPECT_EQ(rows[0].T_world_lidar.t, T.t);
  EXPECT_TRUE(rows[0].final);
  EXPECT_EQ(BytesOf(rows[1]), BytesOf(own));
}

TEST_F(SessionDatabaseTest, TheLastScansOfASequenceComeInOrder) {
  const auto database = Open();
  const std::string sequences[] = {"b", "a", "b", "", "b", "b"};
  for (int i = 0; i < 6; ++i) database->Put(ScanRow(i, std::to_string(i), sequences[i]));
  const auto told = [&](std::int64_t to, int most) {
    std::string text;
    for (const ScanRecord& row : database->LastOf("b", to, most)) text += row.file;
    return text;
  };
  EXPECT_EQ(told(6, 2), "45");
  EXPECT_EQ(told(5, 9), "024");
  EXPECT_EQ(told(0, 9), "");
}

TEST_F(SessionDatabaseTest, SequencesTellTheirLastScanAndTheirNumber) {
  const auto database = Open();
  EXPECT_TRUE(database->Sequences(10).empty());
  const std::string sequences[] = {"b", "a", "b", "", "a", "b"};
  for (int i = 0; i < 6; ++i) database->Put(ScanRow(i, std::to_string(i), sequences[i]));
  const auto told = [&](std::int64_t to) {
    std::string text;
    for (const SessionDatabase::Sequence& s : database->Sequences(to)) {
      text += s.last.sequence + ":" + s.last.file + "/" + std::to_string(s.scans) + " ";
    }
    return text;
  };
  EXPECT_EQ(told(0), "");
  EXPECT_EQ(told(3), "a:1/1 b:2/2 ");
  EXPECT_EQ(told(100), ":3/1 a:4/2 b:5/3 ");
}

TEST_F(SessionDatabaseTest, SolvesFromAScanOnAreForgotten) {
  {
    const auto database = Open();
    for (int i = 0; i < 10; ++i) {
      SessionSolve solve;
      solve.before_scan = i;
      solve.initial_cost = std::nan("");
      solve.usable = i % 2 == 0;
      database->Put(solve);
    }
    database->DropSolvesFrom(7);
  }
  SQLite::Database database(File());
  EXPECT_EQ(database.execAndGet("SELECT COUNT(*) FROM solves").getInt(), 7);
  EXPECT_EQ(database.execAndGet("SELECT MAX(before_scan) FROM solves").getInt(), 6);
  EXPECT_EQ(database.execAndGet("SELECT SUM(usable) FROM solves").getInt(), 4);
}

TEST_F(SessionDatabaseTest, WhatIsNotCommittedIsUndone) {
  {
    const auto database = Open();
    database->Put(ScanRow(0, "before"));
    database->Begin();
    database->Put(ScanRow(1, "committed"));
    database->Commit();
    database->Begin();
    database->Put(ScanRow(2, "undone"));
    database->SetAside("undone", "");
    database->Finalise({0, SE3(), false});
    EXPECT_TRUE(database->Knows("undone"));
    // No other connection sees it.
    EXPECT_EQ(SessionDatabase(File(), false).scans(), 2);
  }
  const auto database = Open();
  EXPECT_EQ(database->scans(), 2);
  EXPECT_FALSE(database->Knows("undone"));
  EXPECT_EQ(BytesOf(All(*database)[0]), BytesOf(ScanRow(0, "before")));
}

TEST_F(SessionDatabaseTest, MetaIsKept) {
  EXPECT_EQ(Open()->Meta("key"), std::nullopt);
  Open()->SetMeta("key", "one\ntwo");
  Open()->SetMeta("empty", "");
  EXPECT_EQ(Open()->Meta("key"), "one\ntwo");
  EXPECT_EQ(Open()->Meta("empty"), "");
  Open()->SetMeta("key", "three");
  EXPECT_EQ(Open()->Meta("key"), "three");
  const auto execute = [this](const char* statement) {
    SQLite::Database(Path("session.db"), SQLite::OPEN_READWRITE).exec(statement);
  };
  execute("UPDATE meta SET value = 'thrEe' WHERE key = 'key'");
  EXPECT_THAT(MessageOf<InputError>([this] { Open()->Meta("key"); }),
              HasSubstr("is damaged: the checksum of 'key' differs"));
  // Of an older program.
  execute("DELETE FROM meta WHERE key = 'key.crc32'");
  EXPECT_EQ(Open()->Meta("key"), "thrEe");
}

}  // namespace
}  // namespace lamina
