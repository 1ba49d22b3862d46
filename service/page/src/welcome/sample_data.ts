/** The office of `semap demo` with three people and its doors; a file of its own, which only who plays it loads. */

import doors from "../../../semap_service/demo/doors.csv?raw";
import office from "../../../semap_service/demo/office.geojson?raw";
import walk from "../../../semap_service/demo/walk.csv?raw";

export { doors, office, walk };
