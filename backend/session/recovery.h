// How a session goes on: from its newest checkpoint that can be used, or from the map of another
// session, or from nothing.
//
// Private to backend/session.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "backend/mapping/mapping.h"
#include "backend/session/folder.h"
#include "backend/session/options.h"
#include "io/store/session_database.h"

namespace lamina {

struct RecoveredMapping {
  std::unique_ptr<Mapping> mapping;
  std::int64_t scans = 0;  // that are in it
};

// Throws OptionError if the session was begun with other options than these; a new one gets them.
void CheckFixedOptions(const SessionSetup& setup, SessionDatabase* database);

// `make` makes a mapping without scans. Tiles and submaps go back to what they were at the
// checkpoint; checkpoints that cannot be used are set aside. Throws InputError if there is a map to
// localise in and nothing of it can be used.
RecoveredMapping RecoverMapping(const SessionSetup& setup, const SessionFolder& folder,
                                const SessionDatabase& database, const SessionStores& stores,
                                const std::function<std::unique_ptr<Mapping>()>& make);

}  // namespace lamina
