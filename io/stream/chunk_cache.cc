#include "io/stream/chunk_cache.h"

#include <utility>

namespace lamina {

std::uint32_t ChunkCache::NextFile() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return files_++;
}

bool ChunkCache::MakeRoom(std::size_t bytes) {
  while (used_ + bytes > budget_) {
    auto oldest = entries_.end();
    for (auto it = entries_.begin(); it != entries_.end(); ++it) {
      if (it->second.users > 0) continue;
      if (oldest == entries_.end() || it->second.last_use < oldest->second.last_use) oldest = it;
    }
    if (oldest == entries_.end()) return used_ == 0;
    used_ -= oldest->second.bytes;
    spare_.Give(std::move(oldest->second.data));
    entries_.erase(oldest);
  }
  return true;
}

ChunkCache::Entries::iterator ChunkCache::Enter(std::unique_lock<std::mutex>* lock, const Key& key,
                                                std::size_t bytes) {
  for (;;) {
    const auto found = entries_.find(key);
    if (found != entries_.end() && found->second.ready) {
      ++found->second.users;
      return found;
    }
    if (found == entries_.end() && MakeRoom(bytes)) {
      used_ += bytes;
      const auto entry = entries_.emplace(key, Entry{}).first;
      entry->second.bytes = bytes;
      entry->second.users = 1;
      return entry;
    }
    changed_.wait(*lock);
  }
}

void ChunkCache::With(const Key& key, std::size_t bytes, const std::function<ByteBuffer()>& unpack,
                      const std::function<void(std::string_view)>& use) {
  std::unique_lock<std::mutex> lock(mutex_);
  const auto entry = Enter(&lock, key, bytes);
  if (!entry->second.ready) {
    lock.unlock();
    ByteBuffer data;
    try {
      data = unpack();
    } catch (...) {
      lock.lock();
      used_ -= bytes;
      entries_.erase(entry);
      changed_.notify_all();
      throw;
    }
    lock.lock();
    entry->second.data = std::move(data);
    entry->second.ready = true;
    changed_.notify_all();
  }
  entry->second.last_use = ++uses_;
  lock.unlock();
  const auto leave = [&] {
    lock.lock();
    --entry->second.users;
    changed_.notify_all();
  };
  try {
    use(entry->second.data.view());
  } catch (...) {
    leave();
    throw;
  }
  leave();
}

}  // namespace lamina
