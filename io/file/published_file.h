// A file that grows for days while others read it, and is whole at every moment: a part that stays,
// to which bytes are appended, and a tail that is replaced each time.
//
//     file           | stays ............................... | tail |
//     file.partial   | stays ...................... |        one time behind: the next to be shown
//
// Two copies take turns. The one that is not shown is brought up to date, from the other and with
// what is new, is flushed to disk, and the names of the two are exchanged in one step. So each
// publication writes twice what is new and the tail, however long the file is; a reader finds
// it as it was or as it is, even after a power cut; and who has opened it may read on until the
// publication after the next. Costs the disk twice the file.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace lamina {

// Not thread-safe. All members throw OutputError, naming the file, and may be called again then:
// what failed has had no effect. The destructor removes the copy that is not shown.
class PublishedFile {
 public:
  // Whatever has that name now is replaced by the first publication.
  explicit PublishedFile(std::string path);
  ~PublishedFile();
  PublishedFile(const PublishedFile&) = delete;
  PublishedFile& operator=(const PublishedFile&) = delete;

  // To the part that stays; seen from the next publication on.
  void Append(std::string_view bytes);
  // Shows what has been appended so far, and `tail` behind it in the place of the last one.
  void Publish(std::string_view tail);

 private:
  struct Copy {
    int file = -1;
    std::uint64_t stays = 0;  // bytes
  };
  void PrepareNext();
  void Show();
  void DropNext();
  [[noreturn]] void Fail(const char* doing) const;

  std::string path_, next_path_;
  Copy shown_, next_;
};

}  // namespace lamina
