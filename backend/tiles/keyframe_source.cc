#include "backend/tiles/keyframe_source.h"

#include "core/base/error.h"

namespace lamina {

StoredBytes PutAside(std::string_view bytes, ByteStore* store) {
  const std::optional<StoredBytes> place = store->Append(bytes);
  if (!place) throw OutputError("what outgrows memory was put into a store that takes no more");
  return *place;
}

std::string TakeBack(const StoredBytes& place, const ByteStore& store) {
  std::string bytes(static_cast<std::size_t>(place.size), '\0');
  if (!store.Read(place, bytes.data()))
    throw OutputError("what outgrew memory cannot be read again from where it was put");
  return bytes;
}

}  // namespace lamina
