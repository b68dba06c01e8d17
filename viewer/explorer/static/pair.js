// A pair of frames with recorded answers, in a page without a server.

import { get, opening } from "./api.js";
import * as pictures from "./pictures.js";
import * as readout from "./readout.js";
import { set } from "./state.js";

const data = await get("dataset");
set({ a: data.a, b: data.b, heat: false });
pictures.start(data); readout.start(data);
pictures.move(...await opening(await get("queries"), {}));
document.body.dataset.ready = "yes";
