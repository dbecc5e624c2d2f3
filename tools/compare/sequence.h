// One sequence of a comparison: rows that are there are reused, the others made, errors measured.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/progress.h"
#include "tools/compare/config.h"
#include "tools/compare/jobs/jobs.h"
#include "tools/compare/methods.h"
#include "tools/compare/results/plots.h"
#include "tools/compare/results/tables.h"

namespace lamina {

// Files of a sequence.
struct CompareFiles {
  std::string scans;
  std::string reference;  // may be empty
};

struct CompareSequence {
  std::string name;
  // Of all that its scans depend on, for fingerprints.
  std::string identity;
  std::vector<SE3> truth;
  // Makes the files if need be; asked only if there is something to do.
  std::function<CompareFiles()> open;
  std::function<void()> close;
};

struct CompareSettings {
  std::vector<std::string> methods;
  CompareConfig config;
  std::string out;
  // Initial poses of local methods: a file's, the synchronised ones of teaser, or the truth with
  // noise on every pose but the first.
  enum class Initial { kFile, kTeaser, kNoisyTruth };
  Initial initial_kind = Initial::kTeaser;
  std::vector<SE3> initial;  // kFile
  double noise_rotation_deg = 1.0, noise_translation_m = 0.05;
  int seed = 1;
  double time_limit_s = 300.0;
  std::size_t at_once = 1;
  // Methods whose heat maps are written and drawn.
  std::vector<std::string> heat_maps;
  RunProgress::Mode progress = RunProgress::Mode::kAuto;
};

class Comparison {
 public:
  // Makes the folder `out` and writes the configuration there. Throws OutputError.
  Comparison(const CompareSettings& settings, const std::atomic<bool>& stop);

  // Throws InputError when it is interrupted; what was finished is kept.
  CompareColumn Run(const CompareSequence& sequence);

  // Figure 4: BALM and ours, with 20 iterations and to convergence, on scans that are downsampled
  // first (tools/compare/resolution.cc). After Run of the same sequence. Throws as Run does.
  std::vector<ResolutionPoint> StudyResolution(const CompareSequence& sequence,
                                               const std::vector<double>& resolutions_m);

 private:
  struct Work;
  std::string RowFolder(const std::string& sequence) const;
  std::string FingerprintOf(const CompareSequence& sequence, const std::string& config) const;
  // Of the rows of these methods, those that must be made.
  CompareJob Missing(const CompareJob& job, const Work& work) const;
  // Rows of all jobs; a row whose initial poses could not be had says so.
  void MakeRows(const CompareSequence& sequence, Work* work);
  void RunJobs(const std::vector<CompareJob>& jobs, Work* work);
  // What tasks are for, in the words of progress and of messages.
  struct Wording {
    std::string of, on;
  };
  // With progress and messages; false if interrupted.
  bool RunTasks(const std::vector<CompareTask>& tasks, const Wording& wording, std::size_t scans,
                std::size_t at_once) const;
  // False if they cannot be had; *reason says why.
  bool InitialPoses(const CompareSequence& sequence, std::vector<SE3>* poses,
                    std::string* reason) const;
  // Returns the path.
  std::string WriteInitialPoses(const CompareSequence& sequence,
                                const std::vector<SE3>& poses) const;
  void MeasureStructures(const CompareSequence& sequence, Work* work, CompareColumn* column);
  void RunStudy(const CompareSequence& sequence, const std::vector<CompareTask>& tasks) const;

  CompareSettings settings_;
  const std::atomic<bool>& stop_;
  std::string config_path_, config_text_;
};

}  // namespace lamina
