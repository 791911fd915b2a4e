/** The text of `worker.js`, in its own script because few pages need it. */

import text from "../../build/worker.txt";

export default text;
