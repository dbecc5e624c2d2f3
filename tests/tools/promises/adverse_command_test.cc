// `lamina-lab adverse`: the table of promises, rows drawn at random, and what is reported.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/support/program/run_helpers.h"
#include "tests/support/promises.h"
#include "tools/promises/random_rows.h"
#include "tools/promises/report.h"
#include "tools/promises/trial.h"

namespace lamina {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

TEST(AdversePromises, TheShippedOnesCanBeTried) {
  const std::vector<Promise> promises = ReadPromises(ShippedPromises());
  EXPECT_GT(promises.size(), 30u);
  for (const Promise& promise : promises) {
    EXPECT_NO_THROW(CheckTrial(promise, {})) << promise.name;
    if (std::isfinite(promise.drift_percent)) continue;
    EXPECT_LE(promise.within_m, 0.1) << promise.name;
  }
}

class AdverseCommandTest : public RunTest {
 protected:
  std::string Write(const std::string& rows) const {
    const std::string path = Path("promises.md");
    std::ofstream(path)
        << "Text.\n\n| name | a | b | c | d | e | f |\n|---|---|---|---|---|---|---|\n"
        << rows;
    return path;
  }
};

TEST_F(AdverseCommandTest, PromisesAreReadWithPlaceAndRule) {
  const std::vector<Promise> promises =
      ReadPromises(Write("| (all) | `--points 3000` | ../a.yaml map.depth=2 | | | | |\n"
                         "| one | `--scene bays` | | 0.1 | 3 | any | words |\n"));
  ASSERT_EQ(promises.size(), 1u);
  EXPECT_EQ(promises[0].synth, (std::vector<std::string>{"--points 3000", "--scene bays"}));
  EXPECT_EQ(promises[0].set, (std::vector<std::string>{"map.depth=2"}));
  EXPECT_EQ(promises[0].config, Path("../a.yaml"));
  EXPECT_EQ(promises[0].lost, 3);
  EXPECT_FALSE(promises[0].degenerate.has_value());
  EXPECT_EQ(promises[0].tried, "words");
  const Promise drift = ReadPromises(Write("| one | | | 1.5 % | 3 | any | |\n"))[0];
  EXPECT_EQ(drift.drift_percent, 1.5);
  EXPECT_FALSE(std::isfinite(drift.within_m));

  const auto read = [this](const std::string& rows) {
    return [this, rows] { ReadPromises(Write(rows)); };
  };
  EXPECT_THAT(read("| one | | | x | 3 | any | |\n"),
              ThrowsMessage<InputError>(AllOf(HasSubstr("promises.md:5"), HasSubstr("within m"))));
  EXPECT_THAT(read("| one | | | 0.1 | 3 |\n"), ThrowsMessage<InputError>(HasSubstr("columns")));
  EXPECT_THAT(read("| one | | | 0.1 | 3 | 1 | |\n| one | | | 0.1 | 3 | 1 | |\n"),
              ThrowsMessage<InputError>(AllOf(HasSubstr("promises.md:6"), HasSubstr("one"))));
  EXPECT_THAT(read(""), ThrowsMessage<InputError>(HasSubstr("no promise")));
  EXPECT_THAT(
      [&] { CheckTrial(ReadPromises(Write("| x | --scene moon | | 0.1 | 3 | 1 | |\n"))[0], {}); },
      ThrowsMessage<OptionError>(AllOf(HasSubstr("promise x"), HasSubstr("moon"))));
}

TEST_F(AdverseCommandTest, TheTableTellsWhatWasKept) {
  const std::string promises = Write(
      "| (all) | --scene hall --sensor spinning --points 4000 --frames 16 | | | | | |\n"
      "| easy | | | 0.1 | 0 | any | |\n"
      "| hard | | | 0.0001 | 0 | any | |\n"
      "| other | | | 0.1 | 0 | any | |\n");
  const auto adverse = [&](const std::string& out, const std::string& only,
                           const std::string& jobs) {
    return Lamina({"adverse", "--promises", promises, "--out", Path(out), "--seeds", "2", "--only",
                   only, "--jobs", jobs, "--progress", "off"});
  };
  const Outcome outcome = adverse("out", "easy,hard", "2");
  EXPECT_EQ(outcome.code, 1) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("| easy | all 2 |"));
  EXPECT_THAT(outcome.out, HasSubstr("| hard | **0 of 2** |"));
  EXPECT_THAT(outcome.out, HasSubstr("hard, seed 2: 0.0"));
  EXPECT_THAT(outcome.out, Not(HasSubstr("other")));
  EXPECT_EQ(Lines(Bytes(Path("out/trials.csv"))).size(), 5u);
  EXPECT_EQ(Lines(Bytes(Path("out/frames/easy_1.csv"))).size(), 17u);
  adverse("again", "hard", "1");
  EXPECT_EQ(Bytes(Path("again/frames/hard_2.csv")), Bytes(Path("out/frames/hard_2.csv")));
}

bool AreEqual(const Promise& a, const Promise& b) {
  return a.name == b.name && fmt::format("{}", fmt::join(a.synth, " ")) == b.synth.front() &&
         a.config == b.config && a.set == b.set && a.within_m == b.within_m && a.lost == b.lost &&
         a.degenerate == b.degenerate;
}

TEST_F(AdverseCommandTest, RandomRowsAreThoseOfTheirSeed) {
  const auto drawn = [](int rows, int seed) {
    return FormatPromises(DrawPromises(rows, seed, RandomPlaces::kAll));
  };
  EXPECT_EQ(drawn(30, 1), drawn(30, 1));
  EXPECT_EQ(drawn(30, 1).find(drawn(10, 1)), 0u) << "more rows leave the first as they are";
  EXPECT_NE(drawn(30, 1), drawn(30, 2));
}

TEST_F(AdverseCommandTest, RandomRowsCanBeTriedAndAreReadBackAsDrawn) {
  for (const RandomPlaces places :
       {RandomPlaces::kCar, RandomPlaces::kFoot, RandomPlaces::kIndoor, RandomPlaces::kAll}) {
    const std::vector<Promise> drawn = DrawPromises(150, 3, places);
    std::ofstream(Path("drawn.md")) << FormatPromises(drawn);
    const std::vector<Promise> read = ReadPromises(Path("drawn.md"));
    ASSERT_EQ(read.size(), drawn.size());
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      EXPECT_TRUE(AreEqual(drawn[i], read[i])) << drawn[i].name;
      EXPECT_NO_THROW(CheckTrial(read[i], {})) << drawn[i].name;
    }
  }
}

TEST_F(AdverseCommandTest, ARandomRowIsRepeatedFromTheTableThatItLeft) {
  const auto adverse = [&](const std::string& out, std::vector<std::string> options) {
    options.insert(options.begin(), {"adverse", "--out", Path(out), "--progress", "off"});
    return Lamina(options);
  };
  // One that takes little time.
  const std::vector<Promise> drawn = DrawPromises(40, 2, RandomPlaces::kIndoor);
  const auto points = [](const Promise& p) {
    for (const std::string& option : p.synth) {
      const std::size_t at = option.find("--points ");
      if (at != std::string::npos) return std::atoi(option.c_str() + at + 9);
    }
    return 1'000'000;
  };
  const auto cheap =
      std::min_element(drawn.begin(), drawn.end(),
                       [&](const Promise& a, const Promise& b) { return points(a) < points(b); });
  const std::string frames = "/frames/" + cheap->name + "_1.csv";
  const Outcome random = adverse(
      "out", {"--random", "40", "--random-seed", "2", "--places", "indoor", "--only", cheap->name});
  ASSERT_LE(random.code, 1) << random.err;
  EXPECT_EQ(Lines(Bytes(Path("out/trials.csv"))).size(), 2u) << "one seed";
  const std::string table = Path("out/promises.md");
  adverse("again", {"--promises", table, "--only", cheap->name, "--seeds", "1"});
  EXPECT_EQ(Bytes(Path("again" + frames)), Bytes(Path("out" + frames)));

  EXPECT_EQ(adverse("not", {"--random", "3", "--promises", ShippedPromises()}).code, 2);
  const Outcome moon = adverse("not", {"--random", "3", "--places", "moon"});
  EXPECT_EQ(moon.code, 2);
  EXPECT_THAT(moon.err, AllOf(HasSubstr("--places"), HasSubstr("indoor")));
}

}  // namespace
}  // namespace lamina
