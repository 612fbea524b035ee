// What the unit `life` tells of itself: which of its calls came, in order.
#pragma once

#include <string>
#include <vector>

namespace teres::test {

struct Life {
    static constexpr const char* kId = "teres.test.life/1";
    std::vector<std::string> calls;
    double gain = 0.0;
    std::string folder;  // the setting `case`
    bool saw_itself = false;
};

}  // namespace teres::test
