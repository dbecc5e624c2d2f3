#include "tools/doctor/weak_places.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/support/program/run_folders.h"
#include "tools/doctor/place_advice.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// Symptom, first and last scan of a place.
struct Found {
  Symptom symptom;
  std::size_t first, last;
  bool operator==(const Found& o) const {
    return symptom == o.symptom && first == o.first && last == o.last;
  }
  friend void PrintTo(const Found& f, std::ostream* out) {
    *out << KindOf(f.symptom).name << " " << f.first << "-" << f.last;
  }
};

class WeakPlacesTest : public RunFolderTest {
 protected:
  using Change = std::function<void(int i, ScanRecord* scan)>;

  // The places of such a drive.
  std::vector<Found> PlacesOf(const Change& change, int count = 200) {
    WriteRun(Drive(change, count));
    return PlacesOfFolder();
  }

  std::vector<Found> PlacesOfFolder() {
    table_ = std::make_unique<RunTable>(ReadRunTable(Path("run")));
    places_ = std::make_unique<WeakPlaces>(*table_);
    std::vector<Found> found;
    for (const WeakPlace& place : places_->places()) {
      found.push_back({place.symptom, place.first, place.last});
    }
    return found;
  }

  PlaceAdvice AdviceOn(std::size_t i) const {
    return Advise(*table_, *places_, places_->places().at(i));
  }

  std::unique_ptr<RunTable> table_;
  std::unique_ptr<WeakPlaces> places_;
};

bool Within(int i, int first, int last) { return i >= first && i <= last; }

void Lose(ScanRecord* scan) {
  scan->status = "lost";
  scan->matched = 100;
  scan->inlier_share = 0.05;
}

void Skip(ScanRecord* scan, const char* status) {
  scan->skipped = true;
  scan->status = status;
  scan->matched = scan->clusters = scan->points = 0;
}

TEST_F(WeakPlacesTest, ACleanRunHasNone) {
  EXPECT_THAT(PlacesOf({}), IsEmpty());
  // Nor the second scan of a piece, which meets a map of one scan.
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i == 1) scan->inlier_share = 0.15;
              }),
              IsEmpty());
  EXPECT_THAT(PlacesOf({}, 1), IsEmpty());
}

struct Case {
  const char* name;
  Symptom symptom;
  void (*change)(ScanRecord* scan);
};

class EachSymptom : public WeakPlacesTest, public testing::WithParamInterface<Case> {};

TEST_P(EachSymptom, IsFoundWhereItIs) {
  const auto found = PlacesOf([](int i, ScanRecord* scan) {
    if (Within(i, 50, 59) || Within(i, 120, 122)) GetParam().change(scan);
  });
  // The longer one first.
  EXPECT_THAT(found, testing::ElementsAre(Found{GetParam().symptom, 50, 59},
                                          Found{GetParam().symptom, 120, 122}));
}

INSTANTIATE_TEST_SUITE_P(
    , EachSymptom,
    testing::Values(
        Case{"Lost", Symptom::kLost, Lose},
        Case{"Unconverged", Symptom::kUnconverged, [](ScanRecord* scan) { scan->iterations = 20; }},
        Case{"Degenerate", Symptom::kDegenerate,
             [](ScanRecord* scan) {
               scan->status = "degenerate";
               scan->worst_sigma_m = 0.3;
             }},
        Case{"FewInliers", Symptom::kFewInliers,
             [](ScanRecord* scan) {
               scan->matched = 150;
               scan->inlier_share = 0.12;
             }},
        Case{"PoorFit", Symptom::kPoorFit, [](ScanRecord* scan) { scan->inlier_share = 0.4; }},
        Case{"Residual", Symptom::kResidual, [](ScanRecord* scan) { scan->residual_m = 0.15; }},
        Case{"Skipped", Symptom::kSkipped, [](ScanRecord* scan) { Skip(scan, "too_few_points"); }},
        Case{"Slow", Symptom::kSlow, [](ScanRecord* scan) { scan->odometry_ms = 1000.0; }}),
    [](const testing::TestParamInfo<Case>& i) { return std::string(i.param.name); });

TEST_F(WeakPlacesTest, JumpsOfSpeedAndTurnAreFoundByThePoses) {
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i == 70) scan->T_world_lidar.t.y() = 0.6;
              }),
              testing::ElementsAre(Found{Symptom::kSpeedJump, 69, 71}));
  EXPECT_EQ(places_->places()[0].worst_at, 70U);
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i == 70) scan->T_world_lidar.q = ExpSO3({0, 0, 0.6});
              }),
              testing::ElementsAre(Found{Symptom::kTurnJump, 69, 71}));
  // Where stamps are made up, nothing tells the speed.
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                scan->recorded_stamp = false;
                if (i == 70) scan->T_world_lidar.t.y() = 0.6;
              }),
              IsEmpty());
  // Full braking is none.
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                const double t = std::clamp(0.1 * (i - 100), 0.0, 1.25);
                if (i >= 100) scan->T_world_lidar.t.x() = 100.0 + 10.0 * t - 4.0 * t * t;
              }),
              IsEmpty());
}

TEST_F(WeakPlacesTest, MissingScansAndStampsThatGoBack) {
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i < 80) return;
                scan->stamp_ns += 300'000'000;
                scan->T_world_lidar.t.x() += 3.0;
              }),
              testing::ElementsAre(Found{Symptom::kGap, 80, 80}));
  EXPECT_THAT(AdviceOn(0).measured, HasSubstr("about 3 missing"));
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i != 80) return;
                Skip(scan, "stamp_not_after_last");
                scan->stamp_ns -= 900'000'000;
              }),
              testing::Contains(Found{Symptom::kStampBackwards, 80, 80}));
}

TEST_F(WeakPlacesTest, KeyframesAreUnevenAndNotMissing) {
  const auto keyframes = [](int gap_s) {
    return [gap_s](int i, ScanRecord* scan) {
      scan->stamp_ns += 100'000'000LL * (2 * i + i % 3) + (i < 90 ? 0 : 1'000'000'000LL * gap_s);
      scan->T_world_lidar.t.x() = 2.0 * SecondsBetween(1'000'000'000'000LL, scan->stamp_ns);
    };
  };
  EXPECT_THAT(PlacesOf(keyframes(0)), IsEmpty());
  EXPECT_THAT(PlacesOf(keyframes(3)), testing::ElementsAre(Found{Symptom::kGap, 90, 90}));
}

TEST_F(WeakPlacesTest, ANewPieceOfOneRecordingAndNoneOfAnother) {
  const auto two = [](const char* second) {
    return [second](int i, ScanRecord* scan) {
      scan->sequence = i < 100 ? "a" : second;
      scan->piece = i < 100 ? 0 : 1;
      if (i >= 100) scan->T_world_lidar.t.x() -= 100.0;
    };
  };
  EXPECT_THAT(PlacesOf(two("a")), testing::ElementsAre(Found{Symptom::kNewPiece, 100, 100}));
  EXPECT_THAT(PlacesOf(two("b")), IsEmpty());
}

// Localising, scans are a piece of their own until they are found in the map, which is piece 0.
TEST_F(WeakPlacesTest, BeingFoundInAnOlderPieceIsNoFault) {
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) { scan->piece = i < 15 ? 1 : 0; }), IsEmpty());
}

TEST_F(WeakPlacesTest, FolderInTurnsAreNeitherGapsNorJumps) {
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                scan->sequence = i % 2 == 0 ? "a" : "b";
                scan->piece = i % 2;
                if (scan->piece == 1) scan->T_world_lidar.t.y() = 500.0;
                if (scan->piece == 1) scan->stamp_ns -= 7'000'000'000;
              }),
              IsEmpty());
}

TEST_F(WeakPlacesTest, AMapOverItsBudgetIsToldOfTheRun) {
  WriteRun(Drive());
  Write("run/summary.json", R"({"map_over_budget": true, "map_peak_bytes": 31457280})");
  EXPECT_THAT(PlacesOfFolder(), testing::ElementsAre(Found{Symptom::kOverBudget, 0, 199}));
  EXPECT_THAT(AdviceOn(0).settings, Contains("map.budget_mb=33"));
}

TEST_F(WeakPlacesTest, PlacesAFewScansApartAreOne) {
  EXPECT_THAT(PlacesOf([](int i, ScanRecord* scan) {
                if (i == 50 || i == 56 || i == 63) scan->iterations = 20;
              }),
              testing::ElementsAre(Found{Symptom::kUnconverged, 50, 56},
                                   Found{Symptom::kUnconverged, 63, 63}));
  EXPECT_EQ(places_->places()[0].count, 2U);
}

TEST_F(WeakPlacesTest, OfPlacesOfOneLengthTheSymptomDecides) {
  const auto found = PlacesOf([](int i, ScanRecord* scan) {
    if (Within(i, 20, 23)) scan->residual_m = 0.3;
    if (Within(i, 40, 43)) scan->status = "degenerate";
    if (Within(i, 60, 63)) scan->iterations = 20;
    if (Within(i, 80, 83)) Skip(scan, "unreadable");
    if (Within(i, 100, 103)) Lose(scan);
  });
  EXPECT_THAT(found, testing::ElementsAre(
                         Found{Symptom::kLost, 100, 103}, Found{Symptom::kUnconverged, 60, 63},
                         Found{Symptom::kDegenerate, 40, 43}, Found{Symptom::kResidual, 20, 23},
                         Found{Symptom::kSkipped, 80, 83}));
}

TEST_F(WeakPlacesTest, CausesAreReadOffWhatLiesAround) {
  const auto lost_after = [&](const Change& change) {
    const auto found = PlacesOf([&](int i, ScanRecord* scan) {
      if (Within(i, 100, 110)) Lose(scan);
      change(i, scan);
    });
    EXPECT_EQ(found.at(0), (Found{Symptom::kLost, 100, 110}));
    return AdviceOn(0);
  };
  const PlaceAdvice gap = lost_after([](int i, ScanRecord* scan) {
    if (i >= 100) scan->stamp_ns += 9'900'000'000;
  });
  EXPECT_THAT(gap.cause, AllOf(HasSubstr("10.0 s without scans"), HasSubstr("about 100 m")));
  EXPECT_THAT(gap.settings, Contains("frontend.search.max_way_m=150"));
  EXPECT_THAT(gap.measured, HasSubstr("11 of 11 scans lost"));
  EXPECT_THAT(gap.measured, HasSubstr("found again at scan 111"));
  EXPECT_THAT(gap.where, AllOf(HasSubstr("scans 100 to 110"), HasSubstr("m along the way")));
  EXPECT_THAT(lost_after([](int i, ScanRecord* scan) {
                if (Within(i, 100, 110)) scan->points = 3000;
              }).cause,
              HasSubstr("fall from 20000 to 3000"));
  const PlaceAdvice turning = lost_after([](int i, ScanRecord* scan) {
    if (i >= 99) scan->T_world_lidar.q = ExpSO3({0, 0, 0.3});
  });
  EXPECT_THAT(turning.cause, HasSubstr("turns by 17.2°"));
  EXPECT_THAT(turning.settings, Contains("frontend.search.range_deg=30"));
  EXPECT_THAT(lost_after([](int, ScanRecord*) {}).cause, HasSubstr("10 % of a scan meets"));
}

// Whatever is proposed must be an option with a value that it may have.
TEST_F(WeakPlacesTest, EverySettingIsOne) {
  std::size_t settings = 0;
  for (const std::int64_t points : {20000, 1000}) {
    for (const double step_m : {1.0, 4.0}) {
      PlacesOf([&](int i, ScanRecord* scan) {
        scan->points = points;
        scan->T_world_lidar.t.x() = step_m * i;
        if (Within(i, 10, 12)) Lose(scan);
        if (Within(i, 20, 22)) scan->iterations = 20;
        if (Within(i, 30, 32)) scan->status = "degenerate", scan->worst_sigma_m = 0.06;
        if (Within(i, 40, 42)) scan->inlier_share = 0.1;
        if (Within(i, 50, 52)) scan->inlier_share = 0.1, scan->matched = 110;
        if (Within(i, 60, 62)) scan->T_world_lidar.t.y() = 3.0;
        if (Within(i, 70, 72)) scan->odometry_ms = 2000;
        if (i == 80) Skip(scan, "too_few_points");
        if (i == 90) Skip(scan, "unreadable");
        if (i == 100) Skip(scan, "no_room_for_piece");
        if (i == 110) Skip(scan, "too_soon_after_other_sensor");
        if (i == 120) Skip(scan, "stamp_not_after_last");
        if (i >= 130) scan->piece = 1;
        if (i >= 140) scan->stamp_ns += 1'000'000'000;
      });
      EXPECT_GE(places_->places().size(), 12U);
      for (std::size_t i = 0; i < places_->places().size(); ++i) {
        const PlaceAdvice advice = AdviceOn(i);
        EXPECT_FALSE(advice.cause.empty());
        EXPECT_FALSE(advice.settings.empty() && advice.record.empty()) << advice.cause;
        EXPECT_NO_THROW(LoadConfig("", advice.settings)) << advice.cause;
        settings += advice.settings.size();
      }
    }
  }
  EXPECT_GT(settings, 20U);
}

TEST_F(WeakPlacesTest, LinesThatCannotBeUsedAreCounted) {
  WriteRun(Drive([](int i, ScanRecord* scan) {
    if (i == 7) scan->residual_m = std::nan("");
  }));
  const std::string whole = Bytes(Path("run/frames.csv"));
  Write("run/frames.csv", whole.substr(0, whole.size() - 60));
  EXPECT_THAT(PlacesOfFolder(), IsEmpty());
  EXPECT_EQ(table_->scans.size(), 199U);
  EXPECT_THAT(table_->notes, Contains(HasSubstr("1 line left out")));
  Write("run/frames.csv", whole + "nan" + whole.substr(whole.rfind("\n199,") + 4));
  PlacesOfFolder();
  EXPECT_THAT(table_->notes, Contains(HasSubstr("has 'nan' for scan")));
}

TEST_F(WeakPlacesTest, TablesThatCannotBeReadAreNamed) {
  const auto message = [&] { return MessageOf<InputError>([&] { ReadRunTable(Path("run")); }); };
  EXPECT_THAT(message(), HasSubstr("is no folder"));
  WriteRun(Drive());
  Write("run/frames.csv", "");
  EXPECT_THAT(message(), HasSubstr("is empty"));
  Write("run/frames.csv", "scan,status\n");
  EXPECT_THAT(message(), HasSubstr("names no scan"));
  Write("run/frames.csv", "scan,read_ms\n0,1\n");
  EXPECT_THAT(message(), HasSubstr("no column status"));
  Write("run/frames.csv", "scan,status\nx\n\x01,tracked\n");
  EXPECT_THAT(message(), AllOf(HasSubstr("not one of its 2 lines"), HasSubstr("line 2 has 1")));
  Write("run/frames.csv", "scan,status\n0,first\n");
  Write("run/summary.json", "{");
  EXPECT_THAT(message(), HasSubstr("summary.json: is no JSON"));
  std::filesystem::remove(Path("run/frames.csv"));
  EXPECT_THAT(message(), HasSubstr("frames.csv: is missing"));
}

TEST_F(WeakPlacesTest, OlderRunsLackSomeOfIt) {
  WriteRun(Drive());
  Write("run/frames.csv", "scan,status\n0,first\n1,lost\n2,lost\n3,tracked\n");
  for (const char* name : {"summary.json", "config.yaml", "trajectory_tum.txt"}) {
    std::filesystem::remove(Path(std::string("run/") + name));
  }
  EXPECT_THAT(PlacesOfFolder(), testing::ElementsAre(Found{Symptom::kLost, 1, 2}));
  EXPECT_EQ(AdviceOn(0).where, "scans 1 to 2");
  EXPECT_THAT(table_->notes, AllOf(SizeIs(15), Contains(HasSubstr("no column stamp_s")),
                                   Contains(HasSubstr("summary.json is missing"))));
}

TEST_F(WeakPlacesTest, AnOptionThatIsNoMoreIsNoted) {
  WriteRun(Drive());
  Write("run/config.yaml", "map:\n  such_as_was: 1\n");
  EXPECT_THAT(PlacesOfFolder(), IsEmpty());
  EXPECT_THAT(table_->notes, Contains(HasSubstr("'map.such_as_was'")));
}

// A table of an inbox can hold any of these.
TEST_F(WeakPlacesTest, ExtremeNumbersHarmNothing) {
  WriteRun(Drive());
  Write("run/frames.csv",
        "scan,stamp_s,status,piece,points,clusters,matched,iterations,inlier_share,residual_m\n"
        "0,-9223372036.0,first,0,1,1,1,1,inf,1e308\n"
        "1,3999999999.9,tracked,9000000000000000,9e15,-5,9e15,-1,-inf,nan\n"
        "2,-3999999999.9,tracked,-3,0,0,1,1,1e300,0\n"
        "3,5,\x1b[31m,0,0,0,0,0,0,0\n"
        "4,1e99,tracked,0,0,0,0,0,0,0\n"
        "5,6,tracked,1e300,0,0,0,0,0,0\n");
  PlacesOfFolder();
  EXPECT_THAT(table_->notes, Contains(HasSubstr("3 lines left out")));
  for (std::size_t i = 0; i < places_->places().size(); ++i) EXPECT_NE(AdviceOn(i).cause, "");
}

TEST_F(WeakPlacesTest, NegativeStampsAreWrittenAndRead) {
  WriteRun(Drive([](int, ScanRecord* scan) { scan->stamp_ns -= 1'000'500'000'000; }));
  EXPECT_THAT(Bytes(Path("run/frames.csv")), HasSubstr("\n0,-0.500000000,first"));
  EXPECT_THAT(PlacesOfFolder(), IsEmpty());
  EXPECT_THAT(table_->notes, IsEmpty());
}

}  // namespace
}  // namespace lamina
