/** The text of `worker.js`, in a script of its own: few need it. */

import text from "../../build/worker.txt";

export default text;
