import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { brotliCompressSync, gzipSync } from "node:zlib";

import type { Plugin } from "vite";
import { defineConfig } from "vitest/config";

/** Where `npm run dev` finds a running service. */
const SERVICE = process.env["SEMAP_URL"] ?? "http://127.0.0.1:8000";

/** Below this a file is sent as it is. */
const WORTH_BYTES = 1000;

/** Writes each file compressed as well, so that the service need not compress it for each browser. */
function compressed(): Plugin {
  return {
    name: "compressed",
    apply: "build",
    writeBundle: ({ dir }) => {
      for (const each of readdirSync(dir!, { recursive: true, withFileTypes: true })) {
        const file = join(each.parentPath, each.name);
        if (!each.isFile() || !/\.(js|css|html|svg)$/.test(each.name)) continue;
        const bytes = readFileSync(file);
        if (bytes.length < WORTH_BYTES) continue;
        writeFileSync(`${file}.br`, brotliCompressSync(bytes));
        writeFileSync(`${file}.gz`, gzipSync(bytes, { level: 9 }));
      }
    },
  };
}

export default defineConfig({
  base: "/page/",
  plugins: [compressed()],
  build: {
    outDir: "../semap_service/page_files",
    emptyOutDir: true,
    target: "es2022",
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 1000,
  },
  server: {
    proxy: { "^/(?!page/)": { target: SERVICE, ws: true } },
  },
  test: { include: ["src/**/*.test.ts"] },
});
