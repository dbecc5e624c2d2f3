#include "tools/simulate/study.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "tests/support/scenes/random_scenes.h"
#include "tools/simulate/nees.h"
#include "tools/simulate/plot.h"
#include "tools/simulate/report.h"

namespace lamina {
namespace {

using testing::HasSubstr;

StudyOptions SmallStudy(const std::vector<std::string>& formulations) {
  StudyOptions study;
  for (const std::string& name : formulations) {
    study.formulations.push_back(&FindFormulation(name));
  }
  study.base.generator = SceneGenerator::kBalm2;
  study.base.poses = 5;
  study.base.planes = 12;
  study.base.points = 15;
  study.sweeps = {{SweepKind::kNoise, {0.01, 0.02}}};
  study.trials = 2;
  return study;
}

std::vector<TrialResult> Results(const StudyOptions& study) {
  std::vector<TrialResult> results;
  RunStudy(
      study,
      [&](const std::vector<TrialResult>& trial) {
        results.insert(results.end(), trial.begin(), trial.end());
      },
      nullptr);
  return results;
}

TEST(SimulateStudy, NeitherThreadsNorTheOtherFormulationsChangeATrial) {
  std::vector<TrialResult> alone, among;
  {
    const ThreadLimit limit(1);
    alone = Results(SmallStudy({"condensed"}));
  }
  {
    const ThreadLimit limit(4);
    among = Results(SmallStudy({"evm1", "condensed"}));
  }
  ASSERT_EQ(alone.size(), 4U);
  ASSERT_EQ(among.size(), 8U);
  for (std::size_t i = 0; i < alone.size(); ++i) {
    const TrialResult &a = alone[i], &b = among[2 * i + 1];
    EXPECT_EQ(b.formulation, &CondensedFormulation());
    EXPECT_EQ(a.seed, b.seed);
    EXPECT_EQ(a.value, b.value);
    EXPECT_EQ(a.cost, b.cost);
    EXPECT_EQ(a.rot_error_deg, b.rot_error_deg);
    EXPECT_EQ(a.trans_error_m, b.trans_error_m);
    EXPECT_EQ(a.iterations, b.iterations);
  }
  EXPECT_NE(alone[0].seed, alone[1].seed);
}

TEST(SimulateStudy, ARowsSeedGivesItsSceneAgain) {
  StudyOptions study = SmallStudy({"condensed"});
  const std::vector<TrialResult> all = Results(study);
  EXPECT_EQ(all[0].seed, study.seed);
  study.seed = all[3].seed;
  study.sweeps[0].values = {all[3].value};
  study.trials = 1;
  const std::vector<TrialResult> one = Results(study);
  ASSERT_EQ(one.size(), 1U);
  EXPECT_EQ(one[0].cost, all[3].cost);
  EXPECT_EQ(one[0].trans_error_m, all[3].trans_error_m);
}

TEST(SimulateStudy, WithoutNoisePosesAreExact) {
  StudyOptions study = SmallStudy({"condensed", "evm2", "huang", "plane_landmarks"});
  study.sweeps[0].values = {0.0};
  const std::vector<TrialResult> results = Results(study);
  ASSERT_FALSE(results.empty());
  for (const TrialResult& r : results) {
    const std::string name = r.formulation->name;
    EXPECT_LT(r.rot_error_deg, 1e-5) << name;
    EXPECT_LT(r.trans_error_m, 1e-6) << name;
    EXPECT_TRUE(r.success) << name << " " << r.cost_gap;
  }
}

TEST(SimulateStudy, StopsBetweenTrials) {
  std::atomic<bool> stop{false};
  int trials = 0;
  RunStudy(
      SmallStudy({"condensed"}), [&](const std::vector<TrialResult>&) { stop = ++trials == 3; },
      &stop);
  EXPECT_EQ(trials, 3);
}

TEST(SimulateStudy, SweptValuesReachTheScene) {
  const SimulationOptions base;
  EXPECT_EQ(AtValue(base, SweepKind::kPlanes, 33).planes, 33);
  EXPECT_EQ(AtValue(base, SweepKind::kPoses, 4).poses, 4);
  EXPECT_EQ(AtValue(base, SweepKind::kPoints, 5).points, 5);
  EXPECT_EQ(AtValue(base, SweepKind::kNoise, 0.5).noise_m, 0.5);
  EXPECT_EQ(AtValue(base, SweepKind::kStart, 20).start_deg, 20.0);
  EXPECT_DOUBLE_EQ(AtValue(base, SweepKind::kStart, 20).start_m, 0.5);
  EXPECT_THROW(AtValue(base, SweepKind::kPlanes, 3.5), OptionError);
  EXPECT_THROW(AtValue(base, SweepKind::kPoses, 1e12), OptionError);
  EXPECT_THROW(AtValue(base, SweepKind::kNoise, -1.0), OptionError);
}

TEST(SimulateReport, MediansAndShares) {
  std::vector<TrialResult> results(4);
  for (std::size_t i = 0; i < 4; ++i) {
    results[i].iterations = static_cast<int>(10 * i);
    results[i].success = i < 3;
    if (i < 1) results[i].iterations_to_optimum = 7;
  }
  results[3].value = 1.0;
  const std::vector<TrialSummary> summaries = SummariseTrials(results);
  ASSERT_EQ(summaries.size(), 2U);
  EXPECT_EQ(summaries[0].trials, 3);
  EXPECT_EQ(summaries[0].iterations, 10.0);
  EXPECT_EQ(summaries[0].success_share, 1.0);
  EXPECT_NEAR(summaries[0].optimum_share, 1.0 / 3.0, 1e-12);
  EXPECT_EQ(summaries[0].iterations_to_optimum, TrialResult::kNever);
  EXPECT_EQ(summaries[1].success_share, 0.0);
  const nlohmann::json json =
      nlohmann::json::parse(SummaryJson(SmallStudy({"condensed"}), summaries).dump());
  EXPECT_TRUE(json["medians"][0]["iterations_to_1e-8"].is_null());
  EXPECT_EQ(json["medians"][0]["iterations"], 10.0);
}

TEST(SimulatePlot, HasAColumnForEachSweepAndACurveForEachFormulation) {
  std::vector<TrialSummary> summaries;
  for (const SweepKind sweep : {SweepKind::kPlanes, SweepKind::kNoise}) {
    for (const char* f : {"condensed", "plane_landmarks"}) {
      for (const double value : {3.0, 1.0}) {
        TrialSummary s;
        s.sweep = sweep;
        s.formulation = &FindFormulation(f);
        s.value = value;
        s.trans_error_m = s.ms = value;
        summaries.push_back(s);
      }
    }
  }
  const std::string script = StudyScript(summaries, "x.png");
  EXPECT_THAT(script, HasSubstr("layout 2,2"));
  EXPECT_THAT(script, HasSubstr("$sweep0_0 << EOD\n1 1 1\n3 3 3\nEOD"));
  EXPECT_THAT(script, HasSubstr("title 'plane_landmarks'"));
  EXPECT_THAT(script, HasSubstr("'noise (m)'"));
}

TEST(SimulateNees, IntervalOfTheMean) {
  // Table values of the chi-square distribution with 10 and with 100 degrees of freedom.
  EXPECT_NEAR(MeanNeesInterval(10, 1, 0.95).low, 3.247, 1e-3);
  EXPECT_NEAR(MeanNeesInterval(10, 1, 0.95).high, 20.483, 1e-3);
  EXPECT_NEAR(MeanNeesInterval(10, 10, 0.95).low, 7.4222, 1e-4);
  EXPECT_NEAR(MeanNeesInterval(10, 10, 0.95).high, 12.9561, 1e-4);
}

TEST(SimulateNees, CovarianceOfCondensedIsHonest) {
  StudyOptions study = SmallStudy({"condensed"});
  study.base.points = 40;
  study.sweeps = {{SweepKind::kNoise, {0.003}}};
  study.trials = 60;
  std::vector<NeesTrial> trials;
  RunNeesStudy(
      study, [&](const NeesTrial& t) { trials.push_back(t); }, nullptr);
  const std::vector<NeesSummary> summaries = SummariseNees(trials);
  ASSERT_EQ(summaries.size(), 1U);
  EXPECT_EQ(summaries[0].degrees_of_freedom, 24);
  EXPECT_EQ(summaries[0].runs, 60);
  EXPECT_TRUE(summaries[0].consistent()) << DescribeNees(summaries[0]);
  study.sweeps[0].values = {0.0};
  EXPECT_THROW(RunNeesStudy(
                   study, [](const NeesTrial&) {}, nullptr),
               OptionError);
}

}  // namespace
}  // namespace lamina
