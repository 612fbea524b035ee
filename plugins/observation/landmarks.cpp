#include "plugins/observation/landmarks.h"

#include "core/case/csv_table.h"
#include "plugins/observation/rigid_registration.h"

namespace teres {

Result<std::vector<Landmark>> read_landmarks(const std::filesystem::path& file) {
    const std::vector<CsvColumn> columns{{"landmark", CsvKind::kText}, {"x_m"}, {"y_m"}, {"z_m"}, {"u_px"}, {"v_px"}};
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, columns));
    std::vector<Landmark> landmarks;
    for (std::size_t row = 0; row < table.num_rows(); ++row)
        landmarks.push_back({table.text(row, 0),
                             {table.number(row, 1), table.number(row, 2), table.number(row, 3)},
                             {table.number(row, 4), table.number(row, 5)}});
    if (landmarks.size() < 3)
        return invalid_input(table.name() + ": " + std::to_string(landmarks.size()) +
                             " landmarks, at least 3 are needed");
    return landmarks;
}

Result<LandmarkPose> pose_from_landmarks(std::span<const Landmark> landmarks, const Lift& lift, double guess_z_m) {
    LandmarkPose out;
    std::vector<Point> camera, model;
    for (const Landmark& landmark : landmarks) {
        const auto seen = lift.at({landmark.pixel}, guess_z_m);
        if (!seen) {
            out.left_out.push_back(landmark.name);
            continue;
        }
        camera.push_back({seen->x.x(), seen->x.y(), seen->x.z()});
        model.push_back(landmark.model);
    }
    TERES_TRY_ASSIGN(out.camera_to_case, align_landmarks(camera, model));
    return out;
}

}  // namespace teres
