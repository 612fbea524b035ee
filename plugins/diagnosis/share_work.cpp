#include "plugins/diagnosis/share_work.h"

#include <future>

namespace teres {

void share_work(bool two, std::size_t count, const std::function<void(std::size_t, std::size_t)>& work) {
    const std::size_t stride = two ? 2 : 1;
    std::future<void> other;  // waits in its destructor if the work of this thread throws
    if (two && count > 1)
        other = std::async(std::launch::async, [&] {
            for (std::size_t k = 1; k < count; k += stride) work(1, k);
        });
    for (std::size_t k = 0; k < count; k += stride) work(0, k);
    if (other.valid()) other.get();
}

}  // namespace teres
