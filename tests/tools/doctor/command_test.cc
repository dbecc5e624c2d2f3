#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <regex>

#include "core/base/error.h"
#include "tests/support/program/run_folders.h"
#include "tests/support/program/run_helpers.h"
#include "tools/doctor/command.h"
#include "tools/doctor/data.h"
#include "tools/doctor/findings.h"
#include "tools/report/page.h"

// Last: a macro of <resolv.h> breaks Eigen's sparse matrices.
#include "tests/support/program/browser.h"

namespace lamina {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

class DoctorTest : public RunFolderTest {
 protected:
  // Lost over 20 scans, then a new piece; ten scans that do not converge; a residual.
  static std::vector<ScanRecord> BadDrive() {
    return Drive([](int i, ScanRecord* scan) {
      if (i >= 40 && i < 50) scan->iterations = kMaxIterations;
      if (i == 80) scan->residual_m = 0.5;
      if (i >= 100 && i < 120) scan->status = "lost";
      if (i >= 120) scan->piece = 1;
    });
  }

  DoctorFindings Found(std::size_t top = 10) const {
    DoctorSource source;
    source.folder = Path("run");
    source.top = top;
    return Examine(source);
  }

  static int Command(const std::string& line) {
    CLI::App app;
    std::function<int()> run;
    AddDoctorCommand(&app, &run);
    app.parse(line, false);
    return run();
  }
};

TEST_F(DoctorTest, TellsTheMostHarmfulFirst) {
  WriteRun(BadDrive());
  const std::string text = DoctorText(Found(), "page.html");
  EXPECT_THAT(text, StartsWith("200 scans, 20 lost; verdict doubtful: "));
  EXPECT_THAT(text, HasSubstr("4 weak places, most harmful first:\n 1. lost: scans 100 to 119, "
                              "10.0 to 11.9 s, 100.0 m along the way\n"));
  const auto at = [&](const char* what) { return text.find(what); };
  EXPECT_LT(at("1. lost"), at("2. matches that did not converge: scans 40 to 49"));
  EXPECT_LT(at("2. matches"), at("3. a new piece of the map: scan 120"));
  EXPECT_LT(at("3. a new"), at("4. large residuals: scan 80"));
  EXPECT_LT(at("4. large"), std::string::npos);
  EXPECT_THAT(text, AllOf(HasSubstr("piece 1 begins at scan 120"), HasSubstr("change    --set "),
                          HasSubstr("see also  3"), HasSubstr("page page.html\n")));
  EXPECT_THAT(DoctorText(Found(1), "p"),
              AllOf(HasSubstr("the 1 of 4 weak places"), Not(HasSubstr("large residuals"))));
}

TEST_F(DoctorTest, AGoodRunIsOneLine) {
  WriteRun(Drive());
  EXPECT_EQ(DoctorText(Found(), "p"), "nothing found: 200 scans; verdict good; page p\n");
  // Of a run without a verdict, it is judged here.
  Write("run/summary.json", "{}");
  EXPECT_EQ(DoctorText(Found(), "p"), "nothing found: 200 scans; verdict good; page p\n");
}

TEST_F(DoctorTest, ARunThatIsAlikeFromEndToEndHasItsVerdict) {
  WriteRun(Drive([](int, ScanRecord* scan) { scan->inlier_share = 0.25, scan->matched = 300; }));
  EXPECT_THAT(DoctorText(Found(), "p"),
              AllOf(HasSubstr("verdict doubtful: the median share of inliers is 0.25"),
                    HasSubstr("no single place stands out")));
}

TEST_F(DoctorTest, NamesOfFilesHaveNoEffect) {
  WriteRun(Drive());
  Write("run/summary.json",
        R"({"verdict": {"verdict": "wrong", "reasons": ["\u001b[31m"], "hint": "</script><b>"}})");
  EXPECT_THAT(DoctorText(Found(), "p"), HasSubstr("verdict wrong: \\x1b[31m"));
  ASSERT_EQ(Command("doctor --run " + Path("run")), 0);
  EXPECT_THAT(Bytes(Path("run/doctor.html")), Not(HasSubstr("</script><b>")));
}

TEST_F(DoctorTest, ThePageHasPicturesOfThePlaces) {
  WriteRun(BadDrive());
  const Json data = DoctorData(Found());
  ASSERT_EQ(data["places"].size(), 4U);
  const Json& lost = data["places"][0];
  EXPECT_EQ(lost["picture"]["piece"], "0");
  EXPECT_NEAR(lost["picture"]["centre"][0], 109.5, 1e-6);
  EXPECT_EQ(lost["chart"]["band"], Json({100, 119}));
  EXPECT_TRUE(lost["chart"]["limit"].is_null());
  const Json& unconverged = data["places"][1];
  EXPECT_EQ(unconverged["chart"]["limit"], 20);
  // Both surfels lie near scan 45: x and y in float32.
  EXPECT_EQ(unconverged["picture"]["map"], Base64Floats({50, 3, 52, -3}));
  EXPECT_EQ(lost["picture"]["map"], "");
  EXPECT_EQ(data["paths"].size(), 2U);
}

TEST_F(DoctorTest, AMapThatIsBrokenIsNoted) {
  WriteRun(BadDrive());
  Write("run/map_surfels.ply", "ply\nnonsense");
  EXPECT_THAT(DoctorData(Found())["notes"].dump(), HasSubstr("pictures are without the map"));
}

TEST_F(DoctorTest, OneFileWithoutAnyReferenceToAnother) {
  WriteRun(BadDrive());
  ASSERT_EQ(Command("doctor --run " + Path("run") + " --out " + Path("page.html")), 0);
  const std::string page = Bytes(Path("page.html"));
  const std::regex kReference(R"re(<(script|link|img)[^>]*(src|href)="([^"]*)")re");
  for (std::sregex_iterator i(page.begin(), page.end(), kReference), end; i != end; ++i) {
    EXPECT_EQ((*i)[3], "data:,") << i->str();
  }
  EXPECT_FALSE(std::filesystem::exists(Path("run/doctor.html")));
  ASSERT_EQ(Command("doctor --run " + Path("run") + " --out " + Path("again.html")), 0);
  EXPECT_EQ(Bytes(Path("again.html")), page);
}

TEST_F(DoctorTest, UsageIsChecked) {
  WriteRun(Drive());
  EXPECT_THROW(Command("doctor"), CLI::ParseError);
  EXPECT_THROW(Command("doctor --top 0 --run " + Path("run")), CLI::ParseError);
  EXPECT_THROW(Command("doctor --run " + Path("none")), InputError);
  EXPECT_THROW(Command("doctor --out " + Path("none/p.html") + " --run " + Path("run")),
               OutputError);
}

TEST_F(DoctorTest, OpensFromAFileAndDraws) {
  if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  WriteRun(BadDrive());
  ASSERT_EQ(Command("doctor --run " + Path("run")), 0);
  Browser browser(Path("profile"), 1280, 900);
  browser.Go("file://" + Path("run/doctor.html"));
  ASSERT_FALSE(browser.WaitFor("!!lamina.data").is_null());
  const std::string text = browser.Run("return document.body.innerText");
  EXPECT_THAT(text, AllOf(HasSubstr("Lamina doctor: run"), HasSubstr("1. lost"),
                          HasSubstr("scans 100 to 119"), HasSubstr("--set "),
                          HasSubstr("doubtful: 10.0 % of the scans are lost")));
  EXPECT_EQ(browser.Run("return document.querySelectorAll('.place').length"), 4);
  EXPECT_EQ(browser.Run("return document.querySelectorAll('.place svg .here').length > 4"), true);
  EXPECT_EQ(browser.Run("return document.querySelectorAll('.place svg .surfel').length"), 1);
  EXPECT_TRUE(
      browser.Run("const c = document.querySelector('#place-2 canvas'); return "
                  "c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some("
                  "(v) => v > 0)"));
  EXPECT_EQ(browser.Run("return document.documentElement.scrollWidth <= innerWidth"), true);
  EXPECT_THAT(browser.Errors(), IsEmpty());
}

class DoctorRunTest : public RunTest {};

// A street; scans 20 to 25 are of another place, scan 30 is empty.
TEST_F(DoctorRunTest, FindsWhereARealRunWasLost) {
  Recording street = Street(40);
  const std::string covered = SyntheticRecording(synth::SceneKind::kRoom, 1, 1)[0].bytes;
  for (std::size_t i = 20; i < 26; ++i) street[i].bytes = covered;
  street[30].bytes = "";
  const std::string scans = WriteRecording("scans", street);
  ASSERT_NE(Lamina({"run", "--scans", scans, "--out", Path("out")}).code, 1);
  const Outcome outcome = Lamina({"doctor", "--run", Path("out"), "--scans", scans});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(testing::ContainsRegex("lost: scans 20 to 2[5-9], 2.0 to 2.[5-9] s"),
                    HasSubstr("000020.bin to 00002"), HasSubstr("skipped scans: scan 30"),
                    HasSubstr("page " + Path("out/doctor.html"))));
  EXPECT_GT(std::filesystem::file_size(Path("out/doctor.html")), 20000U);
  // A recording of other stamps.
  for (RecordedScan& scan : street) scan.stamp_s += 1000.0;
  const Outcome foreign =
      Lamina({"doctor", "--run", Path("out"), "--scans", WriteRecording("other", street)});
  EXPECT_EQ(foreign.code, 1);
  EXPECT_THAT(foreign.err, HasSubstr("do not belong together"));
}

}  // namespace
}  // namespace lamina
