/** Firefox with WebGPU in software, which shows canvases that Chromium leaves empty. */

import { type ChildProcess, spawn } from "node:child_process";
import { existsSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { temporaryFolder } from "./support.js";

const [PROGRAM, DRIVER] = [process.env.FIREFOX ?? "/usr/bin/firefox-esr", "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json"];

/** Why there is none; null where there is. */
export function withoutFirefox(): string | null {
  const missing = [PROGRAM, DRIVER].filter((path) => !existsSync(path));
  return missing.length > 0 ? `${missing.join(" and ")} not installed` : null;
}

const PREFERENCES = {
  "dom.webgpu.enabled": true,
  "gfx.webgpu.ignore-blocklist": true,
  "gfx.webgpu.force-enabled": true,
  "browser.shell.checkDefaultBrowser": false,
  "datareporting.policy.dataSubmissionEnabled": false,
  "app.update.enabled": false,
  "network.captive-portal-service.enabled": false,
  "network.connectivity-service.enabled": false,
};

/** Opens an address in a Firefox without a window; what ends it. */
export function openFirefox(address: string): () => void {
  const profile = temporaryFolder();
  writeFileSync(join(profile.path, "user.js"), Object.entries(PREFERENCES).map(([name, value]) => `user_pref("${name}", ${value});`).join("\n"));
  const env = { ...process.env, VK_ICD_FILENAMES: DRIVER, MOZ_HEADLESS: "1", HOME: profile.path };
  const firefox: ChildProcess = spawn(PROGRAM, ["--headless", "--no-remote", "--profile", profile.path, address], { env, stdio: "ignore", detached: true });
  return () => {
    // With its children.
    if (firefox.pid && firefox.exitCode === null) process.kill(-firefox.pid, "SIGKILL");
    profile.remove();
  };
}
