// The stages of a campaign, each of which leaves its results whole or not at all:
//
//     map      each recording as `lamina run --loops on` does   DIR/drives/NAME
//     join     all of them as `lamina merge` does               DIR/map
//
// With --level keyframes each drive keeps its keyframes (keyframes.bin), and the joined map is
// adjusted once more by all of them (tools/merge/keyframe_level.h).
//
// A folder is made under a name of its own (NAME.part) and renamed when all of it is on disk. What
// is there already, of the same scans and options (campaign.yaml in the folder), is kept: a
// campaign that was ended, by whatever, is started again by the same command and goes on. Results
// do not depend on how many ranks there are, nor on who did what.
//
// Recordings are dealt out by their size on disk, the largest first, each to the rank that has
// least so far: known to all without a message. The folder must be one that all ranks see.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backend/tiles/keyframe_bundle.h"
#include "config/recording_list.h"
#include "tools/campaign/ranks.h"
#include "tools/cli/options.h"

namespace lamina {

struct CampaignArguments {
  std::string recordings, out;
  std::string level = "submaps";  // or keyframes
  KeyframeBundleOptions keyframes;
  std::string scratch;  // folder of this process for what outgrows memory; `out` if empty
  ConfigArguments config;
  int threads = 0;
};

// Who maps which recording.
std::vector<std::size_t> DealOut(const std::vector<std::uintmax_t>& bytes, std::size_t ranks);

// Called by all ranks. Returns the exit code: on rank 0, 1 if recordings had to be left out. Throws
// EndedTogether (tools/campaign/together.h) with an InputError, OptionError, OutputError or
// InterruptedError; anything else is of this rank alone.
int RunCampaign(const CampaignArguments& arguments, const Ranks& ranks);

}  // namespace lamina
