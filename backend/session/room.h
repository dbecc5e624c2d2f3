// Room that the disk of a session must have.
//
// A session without room loses nothing: what was durable stays, a file that finds no room is not
// left in part, and the session can be opened again. But it cannot map. So its caller looks
// at the room first: below kWorkingRoomBytes it waits, from RoomToContinue() on it goes on.
#pragma once

#include <cstdint>
#include <string>

namespace lamina {

// What some hundred scans take in the database and its log, in the tiles and in the trajectory.
inline constexpr std::uint64_t kWorkingRoomBytes = 16 << 20;

// The working room, and that of a checkpoint as large as the newest of the session in `folder`.
std::uint64_t RoomToContinue(const std::string& folder);

}  // namespace lamina
